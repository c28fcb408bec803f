"""Writes files atomically."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from smarts.errors import SmartsError

PARTIAL = ".partial-"


@contextmanager
def written_whole(out: Path) -> Iterator[Path]:
    """Yield a path in a temporary folder beside `out`; its file replaces `out` if the block succeeds.

    Missing folders are made. If the block fails, an existing file stays as it was.

    Raises:
        SmartsError: The file cannot be written.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        # A folder of its own: another process may write the same file at the same time.
        with tempfile.TemporaryDirectory(prefix=PARTIAL, dir=out.parent) as folder:
            partial = Path(folder, out.name)
            yield partial
            partial.replace(out)
    except OSError as error:
        raise SmartsError(
            f"the file cannot be written: {error.strerror or error}",
            place=str(out),
            remedy="name another file, in a folder that can be written to",
        ) from error
