"""Runs other programs, for a limited time."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

TIME_LIMIT = 600.0
"""Default time limit of scenario files and map converters [s]; see `TIME_LIMIT_VARIABLE`."""
TIME_LIMIT_VARIABLE = "SMARTS_BUILD_TIME_LIMIT"
"""The environment variable with another time limit [s]."""


def time_limit() -> float:
    """Return the time limit of one child [s]."""
    return float(os.environ.get(TIME_LIMIT_VARIABLE) or TIME_LIMIT)


def run_child(
    command: Sequence[str],
    *,
    cwd: Path,
    env: Mapping[str, str],
    stderr: IO | None = None,
    keep: Sequence[int] = (),
) -> int:
    """Run a program to its end and return its exit code.

    Args:
        command: The program and its arguments.
        cwd: Its working directory.
        env: Its environment.
        stderr: Where both its outputs for people go; unless given, where this process's go. A file, never a
            pipe, which something that the child leaves behind would keep open.
        keep: File descriptors that it inherits.

    Raises:
        OSError: The program does not start.
        TimeoutError: It ran for longer than `time_limit` and was killed.
    """
    limit, stdout = time_limit(), subprocess.DEVNULL if stderr else None
    streams = {"stdin": subprocess.DEVNULL, "stdout": stdout, "stderr": stderr}
    try:
        done = subprocess.run(command, cwd=cwd, env=env, pass_fds=keep, timeout=limit, check=False, **streams)
    except subprocess.TimeoutExpired as error:
        raise TimeoutError(f"ended after {limit:g} s") from error
    return done.returncode
