"""Actions as users give them -> numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.errors import ActionError, shown


def numbers_of(action: Any, shape: tuple[int, ...], *, place: str, remedy: str) -> NDArray[np.float64]:
    """Return an action as finite numbers.

    NumPy would take None, truths, texts, bytes and dates for numbers, too; here they are none.

    Args:
        action: A number, or what NumPy makes an array of.
        shape: That the numbers are to have; lists of one number count as that number and the other way round.
        place: Whose action it is, for errors.
        remedy: What to give instead.

    Raises:
        ActionError: It is not made of numbers, of another shape, or not finite.
    """
    cause, values = None, None
    try:
        values = as_floats(action)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        cause = error
    if values is None:
        raise refusal(action, "is not made of numbers", place, remedy) from cause
    if values.size != np.prod(shape, dtype=int):
        raise refusal(action, f"is of shape {values.shape}, not {shape}", place, remedy)
    if not np.isfinite(values).all():
        raise refusal(action, "is not finite", place, remedy)
    return values.reshape(shape)


def as_floats(given: Any) -> NDArray[np.float64] | None:
    """Return numbers as they were given, whole ones of any size, or None if something else is among them."""
    values = np.asarray(given)
    is_number = values.dtype.kind in "iuf" or (values.dtype.kind == "O" and all(map(_is_real, values.flat)))
    return values.astype(np.float64) if is_number and not np.ma.is_masked(given) else None


def refusal(action: Any, problem: str, place: str, remedy: str) -> ActionError:
    """Return the error of an action, however large that is."""
    return ActionError(f"{shown(action, 100)} {problem}", place=place, remedy=remedy)


def _is_real(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
