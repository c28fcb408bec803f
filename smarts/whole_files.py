"""Writes files atomically."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path

from smarts.errors import SmartsError

PARTIAL = ".partial-"
_FULL = (errno.ENOSPC, errno.EDQUOT)


@contextmanager
def written_whole(out: Path) -> Iterator[Path]:
    """Yield a path in a temporary folder beside `out`; its file replaces `out` if the block succeeds.

    Missing folders are made. If the block fails, an existing file stays as it was.

    Raises:
        SmartsError: The file cannot be written.
    """
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        # A folder of its own: another process may write the same file at the same time.
        temporary = tempfile.TemporaryDirectory(prefix=PARTIAL, dir=out.parent)
    with temporary as folder:
        partial = Path(folder, out.name)
        with writing(out, only=_FULL):  # the block may fail for reasons of its own
            yield partial
        with writing(out):
            partial.replace(out)


@contextmanager
def writing(out: Path, only: Container[int | None] | None = None) -> Iterator[None]:
    """Name a file in the errors of a block that writes it.

    Args:
        out: The file.
        only: Numbers of the errors that are of writing; None: all are.

    Raises:
        SmartsError: The file cannot be written.
    """
    try:
        yield
    except OSError as error:
        if only is not None and error.errno not in only:
            raise
        raise SmartsError(
            f"the file cannot be written: {error.strerror or error}",
            place=str(out),
            remedy="name another file, in a folder that can be written to",
        ) from error
