"""Which values settings may take. Each config class declares in `ranges` those of the settings it defines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from numbers import Integral, Real
from typing import Any, NamedTuple, Protocol

from algorithms.parts.schedule import is_schedule


class Values(Protocol):
    """The values that a setting may take."""

    def fault(self, value: Any) -> str | None:
        """Return what a value is not, to be read behind "setting=value is", or None if it may be taken."""
        ...


Ranges = Mapping[str, Values | None]
"""What a config class says of its settings; None: anything."""


class Range(NamedTuple):
    """An interval of numbers.

    Attributes:
        low: Smallest number.
        high: Largest number.
        whole: Whether only whole numbers are meant.
        above: Whether `low` itself is excluded.
        optional: Whether None may be taken too.
        scheduled: Whether a schedule of such numbers may be taken too.
    """

    low: float
    high: float = inf
    whole: bool = False
    above: bool = False
    optional: bool = False
    scheduled: bool = False

    def fault(self, value: Any) -> str | None:
        """Return what the value is not, or None."""
        if self.scheduled and isinstance(value, list | tuple):
            fine = is_schedule(value) and all(self.holds(number) for _, number in value)
            return None if fine else "not a schedule, as [[0, 0.01], [10000, 0.001]]"
        return None if self.holds(value) or (self.optional and value is None) else f"not {self}"

    def holds(self, value: Any) -> bool:
        """Return whether the value is a number of this range."""
        kinds = Integral if self.whole else Real
        if isinstance(value, bool) or not isinstance(value, kinds):
            return False
        number: Any = value  # not as a float, which some whole numbers are too large for
        return self.low <= number <= self.high and not (self.above and number == self.low)

    def __str__(self) -> str:
        kind = "a whole number" if self.whole else "a number"
        least = f"above {self.low:g}" if self.above else f"of at least {self.low:g}"
        return f"{kind} {least}" + ("" if self.high == inf else f" and at most {self.high:g}")


FRACTION, POSITIVE, COUNT = Range(0, 1), Range(0, above=True), Range(1, whole=True)
NOT_NEGATIVE, NUMBER = Range(0), Range(0, whole=True)
WIDEST, DEEPEST = 16_384, 100
"""Width of a layer, and number of layers, of the largest networks: more is a slip, or out of memory."""
WIDTH = Range(1, WIDEST, whole=True)


class Widths(NamedTuple):
    """Widths of layers, of which there are at most `DEEPEST`.

    Attributes:
        least: Smallest number of layers.
    """

    least: int = 0

    def fault(self, value: Any) -> str | None:
        """Return what the value is not, or None."""
        if not isinstance(value, tuple | list) or not all(WIDTH.holds(width) for width in value):
            return f"not a tuple of widths from 1 to {WIDEST}, as (64, 64)"
        fits = self.least <= len(value) <= DEEPEST
        return None if fits else f"not a tuple of {self.least} to {DEEPEST} widths"


class FirstAndLast(NamedTuple):
    """Two probabilities, from the first to the second of which something goes."""

    def fault(self, value: Any) -> str | None:
        """Return what the value is not, or None."""
        pair = isinstance(value, tuple | list) and len(value) == 2
        fine = pair and all(FRACTION.holds(chance) for chance in value)
        return None if fine else "not a pair (first, last) of probabilities"


class Either(NamedTuple):
    """One of two words."""

    first: str
    second: str

    def fault(self, value: Any) -> str | None:
        """Return what the value is not, or None."""
        return None if value in self else f"neither {self.first!r} nor {self.second!r}"


def declared(config: type) -> Ranges:
    """Return the values that settings may take, as the classes of a config declare them, the nearest last.

    A class that gives a setting another meaning declares its values anew, or None for any.
    """
    found: dict[str, Values | None] = {}
    for kind in reversed(config.__mro__):
        found |= vars(kind).get("ranges", {})
    return found


def faults(config: type, settings: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence on every setting whose value cannot be meant."""
    for name, values in declared(config).items():
        fault = values.fault(settings[name]) if values is not None and name in settings else None
        if fault is not None:
            yield f"{name}={settings[name]!r} is {fault}"
