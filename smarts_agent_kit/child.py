"""The program of a child process: supervises a process that serves an agent.

`processes.start_process` runs it as a script. The supervisor ends all that the agent has started, however it
was started, when the agent's process ends or the simulator does. That keeps an agent's mistakes from the
simulator; it is no sandbox.
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
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

_SET_DEATH_SIGNAL, _SET_CHILD_SUBREAPER = 1, 36  # of <sys/prctl.h>


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
        except Exception:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(1)
    has_ended = _watch(worker, (lifeline, given["fd"]))
    with suppress(ProcessLookupError):  # as a whole, however fast it forks
        os.killpg(worker, signal.SIGKILL)
    os.kill(worker, signal.SIGKILL)
    _, status = os.waitpid(worker, 0)
    end_children()
    with suppress(Exception):  # the simulator is gone
        if has_ended:
            _tell(given, ending(status))
    os.close(given["fd"])
    shutil.rmtree(given["folder"], ignore_errors=True)
    os._exit(0)


def _watch(worker: int, simulator: Sequence[int]) -> bool:
    """Wait until the agent's process or the simulator ends; return whether the process has.

    Args:
        worker: The agent's process.
        simulator: The lifeline, and the connection to the simulator.
    """
    poll, (lifeline, connection) = select.poll(), simulator
    for each in (lifeline, os.pidfd_open(worker)):
        poll.register(each, select.POLLIN | select.POLLHUP)
    # The agent may be busy or blocked, and read nothing; the simulator is heard here all the same.
    poll.register(connection, select.POLLRDHUP | select.POLLHUP)
    poll.poll()
    return os.waitid(os.P_PID, worker, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def ending(status: int) -> str:
    """Return how a process has ended, from its wait status."""
    if not os.WIFSIGNALED(status):
        return f"its process has ended with exit code {os.waitstatus_to_exitcode(status)}"
    name = signal.Signals(os.WTERMSIG(status)).name
    cause = ", by a user or for want of memory" if name == "SIGKILL" else ""
    return f"its process was killed by {name}{cause}"


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
            for pid in _children():
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


def _children() -> list[int]:
    """Return the children of this process."""
    found: list[int] = []
    for task in os.listdir("/proc/self/task"):
        found += map(int, Path(f"/proc/self/task/{task}/children").read_text().split())
    return found


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


if __name__ == "__main__":
    main()
