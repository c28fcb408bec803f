"""Folders for what a process is writing, which a later process removes if the first one was killed."""

from __future__ import annotations

import fcntl
import os
import shutil
import uuid
from contextlib import suppress
from pathlib import Path

_LOCK, _NEW = "lock", ".new"


def make_locked(parent: Path, prefix: str) -> tuple[Path, int]:
    """Make a folder that is locked until its descriptor is closed, or this process ends; return both."""
    while True:
        name = f"{prefix}{uuid.uuid4().hex}"
        # Under another name until it is locked: another process may take it for left behind, and remove it.
        new = parent / f"{_NEW}{name}"
        new.mkdir()
        with suppress(FileNotFoundError):
            # A file that is open for writing: NFS locks neither folders nor what is open for reading.
            lock = os.open(new / _LOCK, os.O_RDWR | os.O_CREAT)
            with suppress(OSError):  # where the file system has no locks, no other process removes it either
                fcntl.flock(lock, fcntl.LOCK_EX)
            return new.rename(parent / name), lock


def remove_left(parent: Path, prefix: str) -> None:
    """Remove the folders of `make_locked` whose processes have ended."""
    for folder in (*parent.glob(f"{prefix}*"), *parent.glob(f"{_NEW}{prefix}*")):
        with suppress(OSError):
            lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(lock)
