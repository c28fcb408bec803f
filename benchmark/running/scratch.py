"""Temporary folders of processes, of which a later process removes what a killed one left."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from smarts.locked_folders import make_locked, remove_left

PREFIX = "smarts-bench-run-"


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Provide a folder for all temporary files of this process; it is removed at the end."""
    place, before = Path(tempfile.gettempdir()), tempfile.tempdir
    remove_left(place, PREFIX)
    folder, lock = make_locked(place, PREFIX)
    tempfile.tempdir = str(folder)
    try:
        yield folder
    finally:
        tempfile.tempdir = before
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)
