"""Runs other programs so that none outlives its parent or runs without limit.

The system kills a child when its parent dies. A child that takes too long, or whose parent is interrupted, is
killed with all processes that it has started.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import IO

from smarts.errors import SmartsError

TIME_LIMIT = 600.0
"""Default time limit of scenario files and map converters [s]; see `TIME_LIMIT_VARIABLE`."""
TIME_LIMIT_VARIABLE = "SMARTS_BUILD_TIME_LIMIT"
"""The environment variable with another time limit [s]."""
MEMORY_LIMIT_VARIABLE = "SMARTS_BUILD_MEMORY_LIMIT"
"""The environment variable with another memory limit of SUMO's trial of a map [GB]."""

_PR_SET_PDEATHSIG = 1


def time_limit(default: float = TIME_LIMIT) -> float:
    """Return the time limit of one child [s].

    Raises:
        SmartsError: The environment variable is not a positive number.
    """
    return _limit(TIME_LIMIT_VARIABLE, default, "the time limit", "seconds, such as 600")


def memory_limit(default: float) -> float:
    """Return the memory limit of one child [GB].

    Raises:
        SmartsError: The environment variable is not a positive number.
    """
    return _limit(MEMORY_LIMIT_VARIABLE, default, "the memory limit", "gigabytes, such as 8")


def _limit(variable: str, default: float, name: str, wanted: str) -> float:
    text = os.environ.get(variable, "")
    try:
        value = float(text) if text else default
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise SmartsError(f"{name} is {text!r}", place=variable, remedy=f"set it to {wanted}")
    return value


def run_child(
    command: Sequence[str],
    *,
    cwd: Path,
    env: Mapping[str, str],
    stderr: IO | None = None,
    keep: Sequence[int] = (),
    seconds: float | None = None,
    memory: float | None = None,
) -> int:
    """Run a program to its end and return its exit code.

    Args:
        command: The program and its arguments.
        cwd: Its working directory.
        env: Its environment.
        stderr: Where both its outputs for people go; unless given, where this process's go. A file, never a
            pipe, which something that the child leaves behind would keep open.
        keep: File descriptors that it inherits.
        seconds: How long it may run [s]; `time_limit()` unless given.
        memory: The most memory that it may allocate [GB]; any unless given.

    Raises:
        OSError: The program does not start.
        SmartsError: `time_limit` is none.
        TimeoutError: It ran too long and was killed.
    """
    limit = time_limit() if seconds is None else seconds
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
        preexec_fn=_prepare(os.getpid(), memory),
    )
    try:
        return process.wait(limit)
    except subprocess.TimeoutExpired as error:
        raise TimeoutError(f"ended after {limit:g} s") from error
    finally:
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _prepare(parent: int, memory: float | None):
    """Return what a child does before it becomes another program: ask to be killed when its parent dies."""
    prctl = _libc().prctl if sys.platform.startswith("linux") else None

    def prepare() -> None:
        if memory is not None:
            _, hard = resource.getrlimit(resource.RLIMIT_AS)
            most = round(1e9 * memory)
            resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))
        if prctl is not None:
            prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != parent:  # it died before the request
                os._exit(1)

    return prepare


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None)
