"""Checks of users' values; each raises an error that names value, place and remedy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from smarts.errors import SmartsError, shown


class InterfaceError(SmartsError):
    """An agent's interface, or another setting of an environment, has a value that is not allowed."""


def check_whole(name: str, value: Any, least: int, most: int, place: str = "") -> None:
    """Raise unless a value is a whole number in a range.

    Args:
        name: Name of the value.
        value: The value.
        least: The smallest that is allowed.
        most: The largest.
        place: What holds the value; by default its name.

    Raises:
        InterfaceError: The value is something else; names the value and the range.
    """
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or not least <= value <= most:
        raise _refusal(name, value, place, f"give a whole number from {least} to {most}")


def check_number(
    name: str, value: Any, *, least: float = 0.0, most: float = math.inf, above: bool = False, place: str = ""
) -> None:
    """Raise unless a value is a number from `least` (with `above`: above it) to `most`; see `check_whole`."""
    is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    number = _as_float(value) if is_number else math.nan
    if not least <= number <= most or (above and number == least):
        bounds = f"above {least:g}" if above else f"from {least:g}"
        raise _refusal(name, value, place, f"give a number {bounds} to {most:g}")


def keep_whole(owner: Any, name: str, least: int, most: int) -> None:
    """Check a field as `check_whole` does, and store it as a Python int: NumPy's small ones overflow."""
    check_whole(name, getattr(owner, name), least, most, type(owner).__name__)
    object.__setattr__(owner, name, int(getattr(owner, name)))


def keep_number(
    owner: Any, name: str, *, least: float = 0.0, most: float = math.inf, above: bool = False
) -> None:
    """Check a field as `check_number` does, and store it as a Python float: kernels do not take all types."""
    check_number(name, getattr(owner, name), least=least, most=most, above=above, place=type(owner).__name__)
    object.__setattr__(owner, name, float(getattr(owner, name)))


def check_instance(
    name: str, value: Any, kind: type | tuple[type, ...], example: str, place: str = ""
) -> None:
    """Raise unless a value is of a type.

    Raises:
        InterfaceError: The value is of another type; the remedy shows an example.
    """
    if not isinstance(value, kind):
        raise _refusal(name, value, place, f"give {example}")


def check_list(name: str, value: Any, kind: type | tuple[type, ...], example: str, place: str = "") -> None:
    """Raise unless a value is a list (or tuple) of values of a type; a text is not a list of letters.

    Raises:
        InterfaceError: The value is something else; the remedy shows an example.
    """
    if not isinstance(value, list | tuple) or not all(isinstance(item, kind) for item in value):
        raise _refusal(name, value, place, f"give a list such as {example}")


def check_truth(name: str, value: Any, place: str = "") -> None:
    """Raise unless a value is True or False."""
    check_instance(name, value, (bool, np.bool_), "True or False", place)


def _as_float(value: Any) -> float:
    """Return a number as a float, NaN if it is too large for one."""
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _refusal(name: str, value: Any, place: str, remedy: str) -> InterfaceError:
    return InterfaceError(f"{name} is {shown(value)}", place=place or name, remedy=remedy)
