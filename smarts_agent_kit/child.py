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
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

_SET_DEATH_SIGNAL, _SET_CHILD_SUBREAPER = 1, 36  # of <sys/prctl.h>
KILLED = 128
"""Exit code of a supervisor whose agent was killed, but for the number of the signal, as in shells."""


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
    _watch(worker, (lifeline, given["fd"]))
    with suppress(ProcessLookupError):  # as a whole, however fast it forks
        os.killpg(worker, signal.SIGKILL)
    os.kill(worker, signal.SIGKILL)
    _, status = os.waitpid(worker, 0)
    end_children()
    os.close(given["fd"])
    shutil.rmtree(given["folder"], ignore_errors=True)
    code = os.waitstatus_to_exitcode(status)
    os._exit(code if code >= 0 else KILLED - code)


def _watch(worker: int, simulator: Sequence[int]) -> None:
    """Wait until the agent's process or the simulator ends.

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


def ending(code: int) -> str:
    """Return how an agent's process has ended, from the exit code of its supervisor."""
    name = {KILLED + each: each.name for each in signal.Signals}.get(code)
    if name is None:
        return f"its process has ended with exit code {code}"
    cause = ", by a user or for want of memory" if name == "SIGKILL" else ""
    return f"its process was killed by {name}{cause}"


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
    if given["paths"] is not None:
        sys.path[:] = given["paths"]
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
