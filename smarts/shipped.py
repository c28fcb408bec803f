"""Files of the driver's machine on other machines of a Ray cluster.

There this program is unpacked from an archive, in which the user's files lie under their absolute paths. So
paths in configs, results and messages are those of the driver's machine everywhere.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path

PROGRAM = Path(__file__).resolve().parents[1]
"""The folder of the packages."""
SHIPPED = PROGRAM / "shipped"
"""Folder of the user's files, by their absolute paths; there is none where this program is installed."""
TIMES = "times.json"
"""File in that folder: kernels' source file -> time of its change [ns]; if it differs numba recompiles."""


def local(path: str | Path) -> Path:
    """Return where a file or folder of the driver's machine is on this one: the path itself on that one."""
    there = Path(path)
    if there.is_absolute() and (here := SHIPPED / there.relative_to("/")).exists():
        return here
    return there


def original(path: str | Path) -> Path:
    """Return where a file or folder of this machine is on the driver's; the opposite of `local`."""
    here = Path(path)
    return Path("/", here.relative_to(SHIPPED)) if here.is_relative_to(SHIPPED) else here


def restore_times() -> None:
    """Give source files of kernels the times of the driver's, so that its compiled kernels are taken."""
    with suppress(OSError, ValueError):
        for name, time in json.loads((SHIPPED / TIMES).read_text(encoding="utf-8")).items():
            if (PROGRAM / name).stat().st_mtime_ns != time:
                os.utime(PROGRAM / name, ns=(time, time))
