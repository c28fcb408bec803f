"""Action formats: check the actions of one action type and write them into `Actions`.

Each controller declares its format: a `NumbersFormat`, a `PathFormat`, or its own class. The environments
read it by `smarts.controllers.action_format`.

Axis letters: N actions, K numbers of an action, C columns and P points of a path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.errors import ActionError, shown
from smarts.types.actions import Actions

Places = tuple[Any, Any]
"""Simulations and `agent_id`s as an index of `Actions`: two numbers, or two arrays of shape (N,)."""

FAR = 1e7
"""Largest coordinate of an action [m]: maps have none beyond it (`smarts.geometry.frames.FARTHEST`)."""
PATH_POINTS = 32
"""Number of points of a path in an action space; with dict APIs, agents may give fewer or more."""


class Rejected(NamedTuple):
    """The first invalid action of a batch."""

    first: int
    """Index of the action."""
    problem: str


class ActionFormat(Protocol):
    """The format of one action type.

    `parse` and `parse_batch` do all checks and write nothing. Their results are finite and within bounds, so
    `write` cannot fail. A caller parses the actions of all agents before it writes any.
    """

    has_path: bool
    """Whether `write` needs `Actions.path`."""

    def space(self) -> Space:
        """Return a new Gymnasium space of the actions."""
        ...

    def remedy(self) -> str:
        """Return the remedy of error messages: a description of valid actions."""
        ...

    def parse(self, action: Any, place: str, most_points: int) -> Floats:
        """Return the numbers of one action.

        Args:
            action: The action as given by the user.
            place: The place that error messages name.
            most_points: Maximum number of points of a path, the capacity of `Actions.path`.

        Raises:
            ActionError: The action does not have this format, or is not finite.
        """
        ...

    def parse_batch(self, values: NDArray) -> Floats | Rejected:
        """Return the numbers of N elements of the space, or the first invalid one; `values` is numeric."""
        ...

    def write(self, parsed: Floats, places: Places, out: Actions) -> None:
        """Write the result of `parse` for one agent, or of `parse_batch` for N agents."""
        ...


class NumbersFormat:
    """K numbers, clipped to bounds.

    Args:
        low: Lower bounds, shape (K,).
        high: Upper bounds, shape (K,).
        whole: Columns that are rounded to integers.
    """

    has_path = False

    def __init__(self, low: Sequence[float], high: Sequence[float], whole: Sequence[int] = ()) -> None:
        self._low, self._high = np.array(low, np.float64), np.array(high, np.float64)
        self._shape, self._whole = (len(low),), whole

    def space(self) -> Box:
        """Return a new `Box` of shape (K,)."""
        return Box(self._low.astype(np.float32), self._high.astype(np.float32), dtype=np.float32)

    def remedy(self) -> str:
        """Return the remedy of error messages: give an element of the space."""
        return f"give an element of {self.space()}"

    def parse(self, action: Any, place: str, most_points: int) -> Floats:
        """Return K numbers; see `ActionFormat`. If K is 0, any action is valid."""
        if not self._shape[0]:
            return self._low
        return self._clip(numbers_of(action, self._shape, place, self.remedy))

    def parse_batch(self, values: NDArray) -> Floats | Rejected:
        """Return numbers of shape (N, K); see `ActionFormat`."""
        return _first_infinite(values) or self._clip(values)

    def write(self, parsed: Floats, places: Places, out: Actions) -> None:
        """Write the first columns of `Actions.values`."""
        out.values[(*places, slice(parsed.shape[-1]))] = parsed

    def _clip(self, values: NDArray) -> Floats:
        clipped = np.minimum(np.maximum(values, self._low), self._high)
        for column in self._whole:
            # To index by a list takes several times as long.
            clipped[..., column] = np.round(clipped[..., column])
        return clipped


class PathFormat:
    """A path as C columns of 1 to P points each.

    Numbers are clipped, so that their squares and products do not overflow.

    Args:
        columns: The columns of `Actions.path` (time, x, y, heading, speed) that a path holds, shape (C,).
    """

    has_path = True
    _LIMITS = np.array([1000.0, FAR, FAR, 1000.0, 100.0])
    """Largest magnitudes of time [s], x, y [m], heading [rad] and speed [m/s]."""

    def __init__(self, columns: Sequence[int]) -> None:
        self._columns = list(columns)
        self._limits = self._LIMITS[self._columns, None]

    def space(self) -> Box:
        """Return a new `Box` of shape (C, PATH_POINTS)."""
        limits = np.repeat(self._limits, PATH_POINTS, axis=1).astype(np.float32)
        return Box(-limits, limits, dtype=np.float32)

    def remedy(self) -> str:
        """Return the remedy of error messages: give an element of the space."""
        return f"give an element of {self.space()}"

    def parse(self, action: Any, place: str, most_points: int) -> Floats:
        """Return a path of shape (C, P); see `ActionFormat`."""

        def remedy() -> str:
            return f"give {len(self._columns)} columns of 1 to {most_points} points each"

        try:
            shape = np.shape(action)
        except ValueError as error:
            raise rejection(action, "has columns that differ in length", place, remedy) from error
        if len(shape) != 2 or shape[0] != len(self._columns) or not 0 < shape[1] <= most_points:
            raise rejection(action, f"is of shape {shape}", place, remedy)
        return self._clip(numbers_of(action, shape, place, remedy))

    def parse_batch(self, values: NDArray) -> Floats | Rejected:
        """Return paths of shape (N, C, P); see `ActionFormat`."""
        return _first_infinite(values) or self._clip(values)

    def write(self, parsed: Floats, places: Places, out: Actions) -> None:
        """Write paths of P points and their lengths."""
        points = parsed.shape[-1]
        for source, column in enumerate(self._columns):
            out.path[(*places, slice(points), column)] = parsed[..., source, :]
        out.path_length[places] = points

    def _clip(self, values: NDArray) -> Floats:
        return np.clip(values, -self._limits, self._limits)


def numbers_of(action: Any, shape: tuple[int, ...], place: str, remedy: str | Callable[[], str]) -> Floats:
    """Return an action as finite numbers.

    None, booleans, strings, bytes and dates, which NumPy would convert to numbers, are rejected.

    Args:
        action: A number or an array-like.
        shape: Shape of the result; a number and a list of one number are equivalent.
        place: The place that error messages name.
        remedy: The remedy of error messages; a function is called only for an error.

    Raises:
        ActionError: The action is not numeric, has another shape, or is not finite.
    """
    cause, values = None, None
    try:
        values = _as_floats(action)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        cause = error
    if values is None:
        raise rejection(action, "is not made of numbers", place, remedy) from cause
    if values.size != math.prod(shape):
        raise rejection(action, f"is of shape {values.shape}, not {shape}", place, remedy)
    if not np.isfinite(values).all():
        raise rejection(action, "is not finite", place, remedy)
    return values.reshape(shape)


def rejection(action: Any, problem: str, place: str, remedy: str | Callable[[], str]) -> ActionError:
    """Return the error for an invalid action; the action is abbreviated."""
    advice = remedy if isinstance(remedy, str) else remedy()
    return ActionError(f"{shown(action, 100)} {problem}", place=place, remedy=advice)


def _as_floats(given: Any) -> Floats | None:
    """Return numbers as float64, or None if a value is not a number."""
    values = np.asarray(given)
    is_number = values.dtype.kind in "iuf" or (values.dtype.kind == "O" and all(map(_is_real, values.flat)))
    return values.astype(np.float64) if is_number else None


def _is_real(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _first_infinite(values: NDArray) -> Rejected | None:
    is_bad = ~np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    return Rejected(int(np.argmax(is_bad)), "is not finite") if is_bad.any() else None
