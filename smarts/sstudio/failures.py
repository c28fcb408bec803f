"""Turns unexpected exceptions into errors that name the file and the operation."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager

from smarts.errors import ScenarioError, SmartsError

_REMEDIES = {
    errno.ENOSPC: "make room on that disk, and build again",
    errno.EDQUOT: "make room on that disk, and build again",
    errno.EFBIG: "raise the limit on file sizes (ulimit -f), and build again",
    errno.EACCES: "give yourself access to it",
    errno.EPERM: "give yourself access to it",
    errno.ENAMETOOLONG: "use a shorter name",
    errno.EMFILE: "close environments that are not in use any more, or raise the limit (ulimit -n)",
}


@contextmanager
def named_failures(doing: str, place: str) -> Iterator[None]:
    """Turn every exception into an error that names the operation and the user's file.

    Args:
        doing: The operation, as "building the scenario".
        place: The user's file or folder.

    Raises:
        SmartsError: Raised unchanged.
        ScenarioError: In place of every other exception but interruptions.
    """
    try:
        yield
    except SmartsError:
        raise
    except Exception as error:
        raise named(error, doing, place) from error


def named(error: BaseException, doing: str, place: str) -> ScenarioError:
    """Return an exception as an error of the user's file."""
    if isinstance(error, OSError):
        # Running out of file descriptors may surface as another error, such as a missing temporary folder.
        error = _used_up() or error
        where = f" ({error.filename})" if error.filename and str(error.filename) != place else ""
        problem = f"{doing} failed: {error.strerror or error}{where}"
        return ScenarioError(problem, place=place, remedy=_REMEDIES.get(error.errno or 0, ""))
    if isinstance(error, RecursionError):
        remedy = "look for a list or dict that contains itself"
        return ScenarioError(f"{doing} failed: something is nested too deeply", place=place, remedy=remedy)
    if isinstance(error, MemoryError):
        return ScenarioError(f"{doing} failed: not enough memory", place=place)
    said = f": {error}" if str(error) else ""
    return ScenarioError(f"{doing} failed: {type(error).__name__}{said}", place=place)


def _used_up() -> OSError | None:
    """Return the error if the process may open no more files, else None."""
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        return OSError(error.errno, error.strerror)
    return None
