"""The program of a child process: supervises a process that serves an agent.

It is run as a script. The supervisor ends all that the agent has started, however it was started, when the
agent's process ends or the simulator does, or when the agent has too many processes. The agent's process has
limits. That keeps an agent's mistakes from the simulator; it is no sandbox.
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
_ENDED = os.WEXITED | os.WNOHANG | os.WNOWAIT
MOST_PROCESSES = 256
"""Of an agent at a time."""
_TOO_MANY = f"its process was ended: it has started more than {MOST_PROCESSES} processes"
CHECK_TIME = 0.2
"""From one count of the agent's processes to the next [s]."""
PRIORITY = -10
"""Of the supervisor, where it may have one: it is heard beside hundreds of processes that compute."""


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
        os.setpgid(0, 0)
        try:
            os.environ["TMPDIR"] = given["folder"]
            _work(given, supervisor)
        except KeyboardInterrupt:
            os._exit(130)
        finally:
            sys.stderr.flush()
            os._exit(1)
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
    is_modest = _watch(worker, (lifeline, given["fd"]))
    has_ended = os.waitid(os.P_PID, worker, _ENDED) is not None
    with suppress(ProcessLookupError):  # as a whole, however fast it forks
        os.killpg(worker, signal.SIGKILL)
    os.kill(worker, signal.SIGKILL)
    _, status = os.waitpid(worker, 0)
    end_children()
    with suppress(Exception):  # the simulator is gone
        if has_ended or not is_modest:
            _tell(given, ending(status) if is_modest else _TOO_MANY)
    os.close(given["fd"])
    shutil.rmtree(given["folder"], ignore_errors=True)
    os._exit(0)


def _watch(worker: int, simulator: Sequence[int]) -> bool:
    """Wait until the agent's process or the simulator ends; return False if there are too many processes.

    Args:
        worker: The agent's process.
        simulator: The lifeline, and the connection to the simulator.
    """
    poll, (lifeline, connection) = select.poll(), simulator
    for each in (lifeline, os.pidfd_open(worker)):
        poll.register(each, select.POLLIN | select.POLLHUP)
    # The agent may be busy or blocked, and read nothing; the simulator is heard here all the same.
    poll.register(connection, select.POLLRDHUP | select.POLLHUP)
    while not poll.poll(1000.0 * CHECK_TIME):
        while (pid := _ended()) not in (0, worker):  # what the agent has started, and left to itself
            os.waitpid(pid, 0)
        if _has_too_many():
            return False
    return True


def _ended() -> int:
    """Return a child that has ended, which is not waited for; 0: none."""
    found = os.waitid(os.P_ALL, 0, _ENDED)
    return found.si_pid if found else 0


def _has_too_many() -> bool:
    """Return whether this process has more descendants than an agent may have."""
    found = children("self")
    for pid in found:  # it grows meanwhile
        found += children(pid)
        if len(found) > MOST_PROCESSES:
            return True
    return False


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
    with suppress(ChildProcessError):
        while True:
            for pid in children("self"):
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            os.waitpid(-1, 0)
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass


def _work(given: Mapping[str, Any], supervisor: int) -> None:
    """Serve the agent in this process, which dies with its supervisor."""
    _prctl(_SET_DEATH_SIGNAL, int(signal.SIGKILL))
    if os.getppid() != supervisor:
        os._exit(1)
    _take_paths(given)
    importlib.import_module("smarts_agent_kit.worker").work(given)


def children(pid: int | str) -> list[int]:
    """Return the children of a process; none if it has ended."""
    found: list[int] = []
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            found += map(int, Path(f"/proc/{pid}/task/{task}/children").read_text().split())
    return found


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


if __name__ == "__main__":
    main()
