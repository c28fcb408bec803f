"""Pictures and films that are whole or not there."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from smarts.errors import SmartsError

PARTIAL = ".partial-"


@contextmanager
def written_whole(out: Path) -> Iterator[Path]:
    """Provide a file beside `out` to write to, which gets its name when all is in it.

    Raises:
        SmartsError: It cannot be written; what was there before stays.
    """
    partial = out.with_name(f"{PARTIAL}{out.name}")
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
            f"the picture cannot be written: {error.strerror or error}",
            place=str(out),
            remedy="choose another --out",
        ) from error
