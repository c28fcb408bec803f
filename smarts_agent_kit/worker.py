"""What an agent's process does below its supervisor: it limits itself, and answers the simulator."""

from __future__ import annotations

import importlib
import io
import os
import resource
import signal
import socket
import sys
import time
from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from smarts_agent_kit.channel import Channel, ClosedError
from smarts_agent_kit.service import Make, Service
from smarts_agent_kit.wire import WireError

LARGEST_FILE = 2**28
"""The most bytes of a file that an agent writes."""
TIME = 60
"""The most seconds of processor time of one request, on each core."""
SPARE = 1
"""Seconds of processor time after which the limit is set again."""
MOST_TASKS = 4096
"""Processes and threads that the user may have beyond those of now, as long as the agent starts more."""


def work(given: Mapping[str, Any]) -> None:
    """Serve an agent until the simulator closes the connection; `given` is made by `child.command`."""
    confine(given["memory"])
    if isinstance(sys.stdout, io.TextIOWrapper):  # what an agent prints is seen at once, however it ends
        sys.stdout.reconfigure(line_buffering=True)
    load, values = importlib.import_module(given["module"]).load, given["values"]
    serve(given["fd"], load if values is None else lambda _: load(values))


def serve(fd: int, make: Make) -> None:
    """Answer the simulator's requests over a socket until it closes it."""
    os.set_inheritable(fd, False)
    with closing(Channel(socket.socket(fileno=fd))) as channel:
        os.register_at_fork(after_in_child=channel.close)
        service, allowed = Service(make), -TIME
        try:
            while True:
                message = channel.wait()
                if time.process_time() > allowed + SPARE:
                    allowed = allow_time()
                channel.send(service.answer(message))
        except ClosedError:
            return
        except WireError as error:
            print(f"an agent's connection has ended: {error}", file=sys.stderr)


def confine(memory: int) -> None:
    """Limit this process: its memory [bytes], its files, what it starts and the processor time of that."""
    _limit(resource.RLIMIT_DATA, memory)
    if os.getuid():  # the system exempts root
        _limit(resource.RLIMIT_NPROC, tasks_of_user() + MOST_TASKS)
    _limit(resource.RLIMIT_FSIZE, LARGEST_FILE)
    _limit(resource.RLIMIT_CORE, 0)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a write beyond the limit raises an OSError
    os.register_at_fork(after_in_child=allow_time)
    with suppress(OSError):  # where memory runs out, the simulator stays
        Path("/proc/self/oom_score_adj").write_text("1000")


def allow_time() -> float:
    """Allow this process `TIME` more processor time; return what it has used [s]."""
    used, hard = time.process_time(), resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (int(used) + TIME * (os.cpu_count() or 1), hard))
    return used


def tasks_of_user() -> int:
    """Return how many processes and threads this process's user has."""
    count = 0
    for folder in os.scandir("/proc"):
        with suppress(OSError):  # it has ended
            if folder.name.isdecimal() and folder.stat().st_uid == os.getuid():
                count += len(os.listdir(f"{folder.path}/task"))
    return count


def _limit(which: int, value: int) -> None:
    hard = resource.getrlimit(which)[1]
    value = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(which, (value, hard))
