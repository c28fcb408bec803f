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
import resource
import select
import shutil
import signal
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

_SET_DEATH_SIGNAL, _SET_CHILD_SUBREAPER = 1, 36  # of <sys/prctl.h>
LARGEST_FILE = 2**28
"""The most bytes of a file that an agent writes."""
TIME = 60
"""The most seconds of processor time of one request, on each core."""


def command(
    python: Sequence[str],
    fd: int,
    module: str,
    *,
    memory: float,
    paths: Sequence[str] | None = None,
    **more: Any,
) -> list[str]:
    """Return the command that starts a child process with a lifeline as its standard input.

    Args:
        python: The interpreter, with its options.
        fd: Its end of the connection to the simulator.
        module: Has the function `load`, which makes the agent.
        memory: The most that it may write to [GB].
        paths: Its `sys.path`; None: the interpreter's own.
        more: `agent` and `options`, if they are fixed; else they come from the simulator.
    """
    given = {"fd": fd, "module": module, "memory": int(memory * 1e9), "paths": paths, "values": more or None}
    return [*python, str(Path(__file__).absolute()), json.dumps(given)]


def main() -> NoReturn:
    """Start the agent's process, wait until it or the simulator ends, and leave nothing behind."""
    given = json.loads(sys.argv[1])
    _prctl(_SET_CHILD_SUBREAPER, 1)
    folder = tempfile.mkdtemp(prefix="smarts-agent-")
    lifeline, supervisor = os.dup(0), os.getpid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    worker = os.fork()
    if worker == 0:
        os.close(lifeline)
        try:
            os.environ["TMPDIR"] = folder
            _confine(supervisor, given["memory"])
            _work(given)
        except KeyboardInterrupt:
            os._exit(130)
        finally:
            sys.stderr.flush()
            os._exit(1)
    os.close(given["fd"])
    poll = select.poll()
    for each in (lifeline, os.pidfd_open(worker)):
        poll.register(each, select.POLLIN | select.POLLHUP)
    poll.poll()
    end_children()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(0)


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


def allow_time() -> None:
    """Allow this process `TIME` more processor time."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    limit = int(used.ru_utime + used.ru_stime) + TIME * (os.cpu_count() or 1)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, hard))


def _work(given: Mapping[str, Any]) -> None:
    """Serve the agent."""
    if given["paths"] is not None:
        sys.path[:] = given["paths"]
    load, values = importlib.import_module(given["module"]).load, given["values"]
    serve = importlib.import_module("smarts_agent_kit.server").serve_child
    serve(given["fd"], load if values is None else lambda _: load(values))


def _confine(supervisor: int, memory: int) -> None:
    """Limit this process, and let it die with its supervisor."""
    _prctl(_SET_DEATH_SIGNAL, int(signal.SIGKILL))
    if os.getppid() != supervisor:
        os._exit(1)
    _limit(resource.RLIMIT_DATA, memory)
    _limit(resource.RLIMIT_FSIZE, LARGEST_FILE)
    _limit(resource.RLIMIT_CORE, 0)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a write beyond the limit raises an OSError
    os.register_at_fork(after_in_child=allow_time)
    with suppress(OSError):  # of two that have too little memory, the simulator stays
        Path("/proc/self/oom_score_adj").write_text("1000")


def _children() -> list[int]:
    return [int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()]


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _limit(which: int, value: int) -> None:
    hard = resource.getrlimit(which)[1]
    value = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(which, (value, hard))


if __name__ == "__main__":
    main()
