"""Turns errors of the file system into errors that name the user's file and the operation."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from smarts.errors import ScenarioError

_REMEDIES = {
    errno.ENOSPC: "make room on that disk, and build again",
    errno.EDQUOT: "make room on that disk, and build again",
    errno.EACCES: "give yourself access to it",
    errno.EPERM: "give yourself access to it",
    errno.EMFILE: "close environments that are not in use any more, or raise the limit (ulimit -n)",
}


@contextmanager
def named_failures(doing: str, place: str) -> Iterator[None]:
    """Turn errors of the file system into errors that name the operation and the user's file.

    Args:
        doing: The operation, as "building the scenario".
        place: The user's file or folder.

    Raises:
        ScenarioError: In place of an `OSError`.
    """
    try:
        yield
    except OSError as error:
        where = f" ({error.filename})" if error.filename and str(error.filename) != place else ""
        problem = f"{doing} failed: {error.strerror or error}{where}"
        raise ScenarioError(problem, place=place, remedy=_REMEDIES.get(error.errno or 0, "")) from error
