"""Starts and ends the processes of agents."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from smarts_agent_kit.handshake import SECRET

PROGRAM = (
    "import json, sys; given = json.loads(sys.argv[1]); sys.path[:] = given['paths']; "
    "from smarts_agent_kit.worker import work; work(given)"
)
VIEWER = "SMARTS_ENVISION"
"""Names the viewer's server, which agents do not need."""
KEPT = ("PATH", "HOME", "USER", "LANG", "TZ", "TMPDIR", "LD_LIBRARY_PATH", "PYTHONHASHSEED", "SUMO_HOME")
KEPT_PREFIXES = ("LC_", "XDG_", "SMARTS_", "NUMBA_", "CUDA_", "OMP_", "OPENBLAS_", "MKL_")
"""The environment variables that a child process inherits, but for the secret and the viewer's address."""


def start_process(
    fd: int, module: str, *, memory: float, paths: Sequence[str], **values: Any
) -> tuple[subprocess.Popen, str]:
    """Start a process that serves an agent, in a group of its own; its standard input is its lifeline.

    Args:
        fd: Its end of the connection to the simulator; when the simulator closes the other, it ends.
        module: Has the function `load`, which makes the agent.
        memory: The most that it may write to [GB].
        paths: Its `sys.path`.
        values: `agent` and `options`, if they are fixed; else they come from the simulator.

    Returns:
        The process, and the folder of its temporary files; `end_process` takes both.
    """
    folder = tempfile.mkdtemp(prefix="smarts-agent-")
    given = {"fd": fd, "module": module, "memory": int(memory * 1e9), "paths": paths, "folder": folder}
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, json.dumps({**given, "values": values or None})],
        env={
            name: value
            for name, value in os.environ.items()
            if (name in KEPT or name.startswith(KEPT_PREFIXES)) and name not in (SECRET, VIEWER)
        },
        stdin=subprocess.PIPE,
        stdout=2,
        pass_fds=[fd],
        start_new_session=True,
    )
    return process, folder


def end_process(process: subprocess.Popen, folder: str) -> None:
    """End an agent's process and its children, and remove its temporary files."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    with process:
        shutil.rmtree(folder, ignore_errors=True)


def ending(code: int) -> str:
    """Return how an agent's process has ended, from its exit code."""
    if code >= 0:
        return f"its process has ended with exit code {code}"
    name = signal.Signals(-code).name
    cause = ", by a user or for want of memory" if name == "SIGKILL" else ""
    return f"its process was killed by {name}{cause}"
