"""What an agent's process does below its supervisor: it limits its memory, and answers the simulator."""

from __future__ import annotations

import importlib
import io
import os
import resource
import socket
import sys
from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from smarts_agent_kit.channel import Channel, ClosedError
from smarts_agent_kit.service import Make, Service


def work(given: Mapping[str, Any]) -> None:
    """Serve an agent until the simulator closes the connection; see `processes.start_process` for `given`."""
    limit_memory(given["memory"])
    if isinstance(sys.stdout, io.TextIOWrapper):  # what an agent prints is seen at once, however it ends
        sys.stdout.reconfigure(line_buffering=True)
    load, values = importlib.import_module(given["module"]).load, given["values"]
    serve(given["fd"], load if values is None else lambda _: load(values))


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
