"""Settings that change in the course of a training."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

Schedule = float | Sequence[Sequence[float]]
"""A number, or points (step, value), as RLlib writes schedules: the first at step 0, straight lines between
them, and from the last one on its value."""


def value_at(schedule: Schedule, step: int) -> float:
    """Return a schedule's value at an environment step."""
    if isinstance(schedule, int | float):
        return float(schedule)
    after = bisect_right(schedule, step, key=lambda point: point[0])
    if after == len(schedule):
        return float(schedule[-1][1])
    (begin, first), (end, last) = schedule[after - 1], schedule[after]
    return float(first + (last - first) * (step - begin) / (end - begin))


def annealed(ends: tuple[float, float], steps: int, step: int) -> float:
    """Return the value at an environment step on the straight line between two ends, `steps` apart."""
    return value_at(((0, ends[0]), (steps, ends[1])), step)
