"""Files that are whole or not there, and a lock against a second writer."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from smarts.errors import SmartsError

PARTIAL = ".partial"
LOST = "remove it, and what was lost is made again"
"""What to do about a damaged file."""


class ResultsError(SmartsError):
    """Results cannot be written or read, or are of something else."""


def write_whole(file: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` fill a file under another name, and give it its own when it is on disk.

    Raises:
        ResultsError: The disk is full, or the folder cannot be written to. What was there before stays.
    """
    partial = file.with_name(f"{PARTIAL}-{file.name}")
    with named_failures(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            write(partial)
            _to_disk(partial)
            partial.replace(file)
            _to_disk(file.parent)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise


def try_writing(file: Path) -> None:
    """See that a file can be written, before the work whose result it is to hold; leaves what is there.

    Raises:
        ResultsError: The disk is full, or the folder cannot be written to.
    """
    partial = file.with_name(f"{PARTIAL}-{file.name}")
    with named_failures(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.write_bytes(b"x" * 4096)
            _to_disk(partial)
        finally:
            partial.unlink(missing_ok=True)


def write_json(file: Path, content: Any) -> None:
    """Write a JSON file, whole or not at all; see `write_whole`."""
    text = json.dumps(content, indent=1) + "\n"
    write_whole(file, lambda partial: partial.write_text(text, encoding="utf-8"))


def read_json(file: Path, remedy: str = LOST) -> Any:
    """Return the content of a JSON file.

    Args:
        file: Where.
        remedy: What to do if it is damaged.

    Raises:
        ResultsError: It cannot be read, or is damaged.
    """
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultsError(f"cannot be read: {error}", place=str(file), remedy=remedy) from error


def read_mapping(file: Path) -> dict[str, Any]:
    """Return the content of a JSON file that holds keys and values.

    Raises:
        ResultsError: It does not, cannot be read, or is damaged.
    """
    content = read_json(file)
    if not isinstance(content, dict):
        raise ResultsError("holds no keys and values", place=str(file), remedy=LOST)
    return content


def replace_folder(folder: Path, fill: Callable[[Path], Any], *, by: str = "") -> None:
    """Let `fill` write a folder under another name, then put it in the place of the one that was there.

    Between the two a kill leaves the old one under the name of `previous_of`; `recover_folder` puts it back.

    Args:
        folder: Where.
        fill: Writes what is to be in it.
        by: Who writes, if several may at a time; what a kill of them leaves is not recovered.

    Raises:
        ResultsError: The disk is full, or the folder cannot be written to. What was there before stays.
    """
    partial, previous = (
        folder.with_name(f"{each.name}{by}") for each in (_partial_of(folder), previous_of(folder))
    )
    with named_failures(folder):
        shutil.rmtree(partial, ignore_errors=True)
        try:
            fill(partial)
            # Before the old one goes, lest a power cut leave neither.
            for path in (*partial.rglob("*"), partial):
                _to_disk(path)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        shutil.rmtree(previous, ignore_errors=True)
        if folder.exists():
            folder.rename(previous)
        partial.rename(folder)
        _to_disk(folder.parent)
        shutil.rmtree(previous, ignore_errors=True)


def recover_folder(folder: Path) -> None:
    """Put the folder back that a kill left between two names."""
    previous = previous_of(folder)
    if previous.exists() and not folder.exists():
        previous.rename(folder)
    shutil.rmtree(previous, ignore_errors=True)
    shutil.rmtree(_partial_of(folder), ignore_errors=True)


def _partial_of(folder: Path) -> Path:
    return folder.with_name(f"{PARTIAL}-{folder.name}")


def previous_of(folder: Path) -> Path:
    """Return the name of a folder while the one after it takes its place."""
    return folder.with_name(f"{PARTIAL}-previous-{folder.name}")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep others from writing into a folder; the lock goes with the process, however it ends.

    Raises:
        ResultsError: Another process has it, or the folder cannot be written to.
    """
    file = folder / ".lock"
    with named_failures(folder):
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(descriptor, 32, 0).decode(errors="replace").strip() or "another process"
            raise ResultsError(
                f"process {holder} is writing here",
                place=str(folder),
                remedy="wait until it is done, stop it, or give this run another --out",
            ) from error
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def named_failures(place: Path) -> Iterator[None]:
    """Raise errors of the file system as `ResultsError`."""
    try:
        yield
    except OSError as error:
        raise ResultsError(
            f"cannot be written: {error.strerror or error}",
            place=str(place),
            remedy=_REMEDIES.get(error.errno or 0, "name a place that can be written to"),
        ) from error


_FULL = "free some space, and give the same command again to go on"
_REMEDIES = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), _FULL),
    errno.EISDIR: "there is a folder; name a file",
}
"""By number of the file system's error."""


def first_line(error: BaseException) -> str:
    """Return an error in one line."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _to_disk(path: Path) -> None:
    """Wait until a file, or what a folder lists, is on disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
