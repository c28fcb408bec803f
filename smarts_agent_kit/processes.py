"""Starts the processes of agents."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from smarts_agent_kit.handshake import SECRET

PROGRAM = Path(__file__).absolute().with_name("child.py")
VIEWER = "SMARTS_ENVISION"
"""May hold the token of a viewer's server."""
KEPT = ("PATH", "HOME", "USER", "LANG", "TZ", "TMPDIR", "LD_LIBRARY_PATH", "PYTHONHASHSEED", "SUMO_HOME")
KEPT_PREFIXES = ("LC_", "XDG_", "SMARTS_", "NUMBA_", "CUDA_", "OMP_", "OPENBLAS_", "MKL_")
"""The environment variables that a child process inherits, but for the secret and the viewer's token."""


def clean_environment() -> dict[str, str]:
    """Return the environment variables of child processes: no secrets of the user's among them."""
    return {
        name: value
        for name, value in os.environ.items()
        if (name in KEPT or name.startswith(KEPT_PREFIXES)) and name not in (SECRET, VIEWER)
    }


def start_process(
    python: Sequence[str],
    fd: int,
    module: str,
    *,
    memory: float,
    paths: Sequence[str] | None = None,
    **values: Any,
) -> tuple[subprocess.Popen, str]:
    """Start a supervised process that serves an agent; its standard input is its lifeline.

    Args:
        python: The interpreter, with its options.
        fd: Its end of the connection to the simulator; when the simulator closes the other, it ends.
        module: Has the function `load`, which makes the agent.
        memory: The most that it may write to [GB].
        paths: Its `sys.path`; None: the interpreter's own.
        values: `agent` and `options`, if they are fixed; else they come from the simulator.

    Returns:
        The process, and the folder of its temporary files, which it removes when it ends.

    Raises:
        OSError: It does not start.
    """
    folder = tempfile.mkdtemp(prefix="smarts-agent-")
    given = {"fd": fd, "module": module, "memory": int(memory * 1e9), "paths": paths, "folder": folder}
    try:
        process = subprocess.Popen(
            [*python, str(PROGRAM), json.dumps({**given, "values": values or None})],
            env=clean_environment(),
            stdin=subprocess.PIPE,
            stdout=2,
            pass_fds=[fd],
            start_new_session=True,
        )
    except OSError:
        os.rmdir(folder)
        raise
    return process, folder
