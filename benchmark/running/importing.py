"""Errors of own code, with its file and line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from algorithms.errors import AlgorithmError
from smarts.errors import SmartsError
from smarts.registry import FAILURES, is_of_ray, own_error, place_of


@contextmanager
def named_own_code(doing: str) -> Iterator[None]:
    """Raise what comes from own code as an error that names its file and line, and leave other errors.

    Args:
        doing: What runs, for the message.

    Raises:
        OwnCodeError: The innermost line of own code that the error passed through.
    """
    try:
        yield
    except (SmartsError, AlgorithmError):
        raise
    except FAILURES as error:
        if not is_of_ray(error) and (place := place_of(error)):
            raise own_error(error, doing, place) from error
        raise
