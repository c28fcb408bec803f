"""Atomic files and folders of results, and a lock against a second writer."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from smarts.errors import SmartsError

PARTIAL = ".partial"
LOST = "remove it, and what was lost is made again"
"""Remedy of a damaged file."""
FORMAT = 2
"""Version of the format of results; key `format` of run.json and command.json."""


class ResultsError(SmartsError):
    """Results cannot be written or read, or are of another run."""


def write_whole(file: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` fill a temporary file, and rename it when it is on disk.

    Raises:
        ResultsError: The disk is full, or the folder cannot be written to. The old content stays.
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


def write_json(file: Path, content: Any) -> None:
    """Write a JSON file, whole or not at all; see `write_whole`."""
    text = json.dumps(content, indent=1) + "\n"
    write_whole(file, lambda partial: partial.write_text(text, encoding="utf-8"))


def read_json(file: Path, remedy: str = LOST) -> dict[str, Any]:
    """Return the content of a JSON file of keys with values.

    Args:
        file: Its path.
        remedy: What to do if it is damaged.

    Raises:
        ResultsError: It is missing or damaged.
    """
    try:
        return dict(json.loads(file.read_text(encoding="utf-8")))
    except (OSError, TypeError, ValueError, RecursionError) as error:
        raise ResultsError(f"cannot be read: {error}", place=str(file), remedy=remedy) from error


def read_versioned(file: Path) -> dict[str, Any]:
    """Return the content of run.json or command.json without its format.

    Raises:
        ResultsError: It is missing, damaged, or of another format.
    """
    content = read_json(file)
    if (found := content.pop("format", None)) != FORMAT:
        problem = f"written in format {found}, this version reads format {FORMAT}"
        raise ResultsError(problem, place=str(file), remedy="read it with the program that wrote it")
    return content


def write_versioned(file: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file with the format; see `write_whole`."""
    write_json(file, {"format": FORMAT, **content})


@contextmanager
def replaced_folder(folder: Path) -> Iterator[Path]:
    """Provide an empty folder that replaces the old one when all is written.

    A kill in between leaves the old one under the name of `previous_of`; `recover_folder` restores it.

    Raises:
        ResultsError: The disk is full, or the folder cannot be written to. The old content stays.
    """
    partial, previous = _partial_of(folder), previous_of(folder)
    shutil.rmtree(partial, ignore_errors=True)
    try:
        with named_failures(folder):
            partial.mkdir(parents=True)
            yield partial
            # Before the old one is removed, lest a power cut leave neither.
            for path in (*partial.rglob("*"), partial):
                _to_disk(path)
            shutil.rmtree(previous, ignore_errors=True)
            if folder.exists():
                folder.rename(previous)
            partial.rename(folder)
            _to_disk(folder.parent)
            shutil.rmtree(previous, ignore_errors=True)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check_free(out: Path | None) -> None:
    """Raise unless a folder is new or empty, or none is given.

    Raises:
        ResultsError: It holds something, or is a file.
    """
    if out is not None and out.exists() and (out.is_file() or any(out.iterdir())):
        problem = "is a file" if out.is_file() else f"holds '{min(out.iterdir()).name}'"
        raise ResultsError(problem, place=str(out), remedy="remove it, or choose another --out")


@contextmanager
def new_folder(out: Path | None) -> Iterator[Path]:
    """Provide a folder that becomes `out` when all is written; without one it is removed."""
    check_free(out)
    if out is None:
        with tempfile.TemporaryDirectory(prefix="smarts-bench-") as temporary:
            yield Path(temporary)
        return
    partial = _partial_of(out)
    shutil.rmtree(partial, ignore_errors=True)
    with named_failures(out):
        partial.mkdir(parents=True)
    try:
        yield partial  # errors of what is evaluated are none of this folder
        with named_failures(out):
            partial.replace(out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def files_in(folder: Path) -> dict[str, bytes]:
    """Return the contents of all files of a folder by their paths in it."""
    files = (each for each in sorted(folder.rglob("*")) if each.is_file())
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files of a folder, given by their paths in it, and the folder if there is none."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def recover_folder(folder: Path) -> None:
    """Restore a folder whose replacement was killed."""
    previous = previous_of(folder)
    if previous.exists() and not folder.exists():
        previous.rename(folder)
    shutil.rmtree(previous, ignore_errors=True)
    shutil.rmtree(_partial_of(folder), ignore_errors=True)


def _partial_of(folder: Path) -> Path:
    return folder.with_name(f"{PARTIAL}-{folder.name}")


def previous_of(folder: Path) -> Path:
    """Return the temporary name of a folder that is being replaced."""
    return folder.with_name(f"{PARTIAL}-previous-{folder.name}")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder against other writers; the lock ends with the process.

    Raises:
        ResultsError: Another process holds the lock, or the folder cannot be written to.
    """
    file = folder / ".lock"
    with named_failures(folder):
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        with named_failures(folder):
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                holder = os.pread(descriptor, 32, 0).decode(errors="replace").strip() or "another process"
                raise ResultsError(
                    f"process {holder} is writing here",
                    place=str(folder),
                    remedy="wait until it ends, stop it, or choose another --out",
                ) from error
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def named_failures(place: Path) -> Iterator[None]:
    """Raise file system errors as `ResultsError`."""
    try:
        yield
    except OSError as error:
        raise ResultsError(
            f"cannot be written: {error.strerror or error}",
            place=str(place),
            remedy=_REMEDIES.get(error.errno or 0, "name a place that can be written to"),
        ) from error


_FULL = "free some space, then give the same command again to resume"
_REMEDIES = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), _FULL),
    errno.EISDIR: "there is a folder; name a file",
}
"""Remedies by error number."""


def first_line(error: BaseException) -> str:
    """Return the first line of an error."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _to_disk(path: Path) -> None:
    """Wait until a file or a folder's list is on disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
