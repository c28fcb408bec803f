"""Errors of own code, told with its file and line, as they are on the driver's machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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


@contextmanager
def as_on_the_driver(places: Mapping[str, str]) -> Iterator[None]:
    """Let errors name files as they are on the driver's machine.

    Args:
        places: Folder here -> folder there, of what an error may name.
    """
    try:
        yield
    except (SmartsError, AlgorithmError) as error:
        texts = [error.problem, error.place, error.remedy]
        for here, there in places.items():
            texts = [text.replace(here, there) for text in texts]
        if texts == [error.problem, error.place, error.remedy]:
            raise
        raise type(error)(texts[0], place=texts[1], remedy=texts[2]) from error
