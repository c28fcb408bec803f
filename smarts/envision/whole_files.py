"""Writes files atomically."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from smarts.errors import SmartsError

PARTIAL = ".partial-"


@contextmanager
def written_whole(out: Path) -> Iterator[Path]:
    """Yield a temporary path beside `out`, which replaces `out` if the block succeeds.

    Missing folders are made. If the block fails, an existing file stays as it was.

    Raises:
        SmartsError: The file cannot be written.
    """
    partial = out.with_name(f"{PARTIAL}{os.getpid()}-{out.name}")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        partial.replace(out)
    except BaseException as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        raise SmartsError(
            f"the file cannot be written: {error.strerror or error}",
            place=str(out),
            remedy="name another file, in a folder that can be written to",
        ) from error
