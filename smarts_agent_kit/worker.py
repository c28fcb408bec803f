"""The program of an agent's process: it limits its memory, answers the simulator, and ends with it.

That keeps an agent's mistakes from the simulator; it is no sandbox.
"""

from __future__ import annotations

import importlib
import io
import os
import resource
import select
import shutil
import signal
import socket
import sys
import threading
from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from smarts_agent_kit.channel import Channel, ClosedError
from smarts_agent_kit.service import Make, Service


def work(given: Mapping[str, Any]) -> None:
    """Serve an agent until the simulator closes the connection; see `processes.start_process` for `given`."""
    lifeline = os.dup(0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    # The agent may be busy or blocked, and read nothing; the simulator is heard here all the same.
    simulator = lifeline, given["fd"], given["folder"]
    end = threading.Thread(target=_end_with_simulator, args=simulator, daemon=True)
    end.start()
    os.environ["TMPDIR"] = given["folder"]
    limit_memory(given["memory"])
    if isinstance(sys.stdout, io.TextIOWrapper):  # what an agent prints is seen at once, however it ends
        sys.stdout.reconfigure(line_buffering=True)
    load, values = importlib.import_module(given["module"]).load, given["values"]
    serve(given["fd"], load if values is None else lambda _: load(values))
    end.join()


def _end_with_simulator(lifeline: int, connection: int, folder: str) -> None:
    """Kill this process and its children when the simulator ends; remove its temporary files."""
    poll = select.poll()
    poll.register(lifeline, select.POLLIN | select.POLLHUP)
    poll.register(connection, select.POLLRDHUP | select.POLLHUP)
    poll.poll()
    shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)


def serve(fd: int, make: Make) -> None:
    """Answer the simulator's requests over a socket until it closes it."""
    os.set_inheritable(fd, False)
    with closing(Channel(socket.socket(fileno=fd))) as channel, suppress(ClosedError):
        os.register_at_fork(after_in_child=channel.close)
        service = Service(make)
        while True:
            channel.send(service.answer(channel.wait()))


def limit_memory(size: int) -> None:
    """Limit the memory that this process writes to [bytes]; where the machine's runs out, it ends first."""
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    resource.setrlimit(
        resource.RLIMIT_DATA, (size if hard == resource.RLIM_INFINITY else min(size, hard), hard)
    )
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")
