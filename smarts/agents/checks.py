"""Small checks of what users ask for, each of which raises an error that names the value and what to give."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from smarts.errors import SmartsError, shortened


class InterfaceError(SmartsError):
    """An agent's interface asks for something that cannot be had."""


def check_whole(name: str, value: Any, least: int, most: int, place: str = "") -> None:
    """Refuse what is not a whole number in a range.

    Args:
        name: What the value is called.
        value: The value.
        least: The smallest that is allowed.
        most: The largest.
        place: Of what it is a part; by default its name.

    Raises:
        InterfaceError: It is not; names the value and the range.
    """
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or not least <= value <= most:
        raise _refusal(name, value, place, f"give a whole number from {least} to {most}")


def check_number(
    name: str, value: Any, *, least: float = 0.0, most: float = math.inf, above: bool = False, place: str = ""
) -> None:
    """Refuse what is not a number from `least` (with `above`: above it) to `most`; see `check_whole`."""
    is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not is_number or not least <= value <= most or (above and value == least):
        bounds = f"above {least:g}" if above else f"from {least:g}"
        raise _refusal(name, value, place, f"give a number {bounds} to {most:g}")


def check_instance(
    name: str, value: Any, kind: type | tuple[type, ...], example: str, place: str = ""
) -> None:
    """Refuse what is not of a type.

    Raises:
        InterfaceError: It is not; the remedy shows an example.
    """
    if not isinstance(value, kind):
        raise _refusal(name, value, place, f"give {example}")


def check_list(name: str, value: Any, kind: type | tuple[type, ...], example: str, place: str = "") -> None:
    """Refuse what is not a list (or tuple) of things of a type; a text is not one of its letters.

    Raises:
        InterfaceError: It is not; the remedy shows an example.
    """
    if not isinstance(value, list | tuple) or not all(isinstance(item, kind) for item in value):
        raise _refusal(name, value, place, f"give a list such as {example}")


def check_truth(name: str, value: Any, place: str = "") -> None:
    """Refuse what is neither True nor False."""
    check_instance(name, value, (bool, np.bool_), "True or False", place)


def _refusal(name: str, value: Any, place: str, remedy: str) -> InterfaceError:
    return InterfaceError(f"{name} is {shortened(repr(value), 200)}", place=place or name, remedy=remedy)
