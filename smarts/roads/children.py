"""Runs other programs so that none outlives its parent or runs without limit.

The system kills a child when its parent dies. A child that takes too long, or whose parent is interrupted, is
killed with all processes that it has started.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import IO

TIME_LIMIT = 600.0
"""Default time limit of scenario files and map converters [s]; see `TIME_LIMIT_VARIABLE`."""
TIME_LIMIT_VARIABLE = "SMARTS_BUILD_TIME_LIMIT"
"""The environment variable with another time limit [s]."""

_PR_SET_PDEATHSIG = 1


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
    limit = time_limit()
    process = subprocess.Popen(
        command,
        cwd=cwd,
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL if stderr else None,
        stderr=stderr,
        pass_fds=keep,
        # A group of its own: Ctrl-C reaches the parent alone, which then ends the whole group.
        process_group=0,
        preexec_fn=_prepare(os.getpid()),
    )
    try:
        return process.wait(limit)
    except subprocess.TimeoutExpired as error:
        raise TimeoutError(f"ended after {limit:g} s") from error
    finally:
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _prepare(parent: int):
    """Return what a child does before it becomes another program: ask to be killed when its parent dies."""
    prctl = _libc().prctl if sys.platform.startswith("linux") else None

    def prepare() -> None:
        if prctl is not None:
            prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != parent:  # it died before the request
                os._exit(1)

    return prepare


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None)
