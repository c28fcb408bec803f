"""The program of a child process: supervises a process that serves an agent.

It is run as a script. The supervisor ends all that the agent has started, however it was started, when the
agent's process ends or the simulator does. The agent's process has limits. That keeps an agent's mistakes
from the simulator; it is no sandbox.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import select
import shutil
import signal
import socket
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

_CAUSES = {
    "SIGKILL": ", by a user or for want of memory",
    "SIGXCPU": ": a request took more processor time than is allowed",
}
_SET_DEATH_SIGNAL, _SET_CHILD_SUBREAPER = 1, 36  # of <sys/prctl.h>


def command(
    python: Sequence[str],
    fd: int,
    module: str,
    *,
    folder: str,
    memory: float,
    paths: Sequence[str] | None = None,
    **more: Any,
) -> list[str]:
    """Return the command that starts a child process with a lifeline as its standard input.

    Args:
        python: The interpreter, with its options.
        fd: Its end of the connection to the simulator; when the simulator closes the other, it ends.
        module: Has the function `load`, which makes the agent.
        folder: For its temporary files; it is removed when the process ends.
        memory: The most that it may write to [GB].
        paths: Its `sys.path`; None: the interpreter's own.
        more: `agent` and `options`, if they are fixed; else they come from the simulator.
    """
    given = {
        "fd": fd,
        "module": module,
        "memory": int(memory * 1e9),
        "paths": paths,
        "folder": folder,
        "values": more or None,
    }
    return [*python, str(Path(__file__).absolute()), json.dumps(given)]


def main() -> NoReturn:
    """Start the agent's process, wait until it or the simulator ends, and leave nothing behind."""
    given = json.loads(sys.argv[1])
    _prctl(_SET_CHILD_SUBREAPER, 1)
    lifeline, supervisor = os.dup(0), os.getpid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    worker = os.fork()
    if worker == 0:
        os.close(lifeline)
        try:
            os.environ["TMPDIR"] = given["folder"]
            _work(given, supervisor)
        except KeyboardInterrupt:
            os._exit(130)
        finally:
            sys.stderr.flush()
            os._exit(1)
    poll = select.poll()
    for each in (lifeline, os.pidfd_open(worker)):
        poll.register(each, select.POLLIN | select.POLLHUP)
    # The agent may be busy or blocked, and read nothing; the simulator is heard here all the same.
    poll.register(given["fd"], select.POLLRDHUP | select.POLLHUP)
    poll.poll()
    ended, status = os.waitpid(worker, os.WNOHANG)
    if ended:
        with suppress(Exception):  # the simulator is gone
            _tell(given, ending(status))
    os.close(given["fd"])
    end_children()
    shutil.rmtree(given["folder"], ignore_errors=True)
    os._exit(0)


def ending(status: int) -> str:
    """Return how a process has ended, from its wait status."""
    if not os.WIFSIGNALED(status):
        return f"its process has ended with exit code {os.waitstatus_to_exitcode(status)}"
    name = signal.Signals(os.WTERMSIG(status)).name
    return f"its process was killed by {name}{_CAUSES.get(name, '')}"


def _tell(given: Mapping[str, Any], problem: str) -> None:
    """Send the simulator the last message of an agent whose process has ended."""
    _take_paths(given)
    wire = importlib.import_module("smarts_agent_kit.wire")
    frame = wire.encode(wire.Message("failed", {"problem": problem}))
    with socket.socket(fileno=os.dup(given["fd"])) as connection:
        connection.send(frame, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)


def _take_paths(given: Mapping[str, Any]) -> None:
    if given["paths"] is not None:
        sys.path[:] = given["paths"]


def end_children() -> None:
    """Kill all descendants of this process, which is their reaper."""
    while True:
        for pid in _children():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def _work(given: Mapping[str, Any], supervisor: int) -> None:
    """Serve the agent in this process, which dies with its supervisor."""
    _prctl(_SET_DEATH_SIGNAL, int(signal.SIGKILL))
    if os.getppid() != supervisor:
        os._exit(1)
    _take_paths(given)
    importlib.import_module("smarts_agent_kit.worker").work(given)


def _children() -> list[int]:
    return [int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()]


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


if __name__ == "__main__":
    main()
