"""Random numbers of native traffic: functions of the episode's seed, the vehicle, the step and the use."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from smarts.geometry.compiling import kernel

HEADWAY, TYPE, FACTOR, PLACE, DAWDLE, FOE = range(6)
"""The uses. The first four are keyed by flow and count, the others by vehicle and step."""


@kernel
def draw(seed: int, which: int, step: int, use: int) -> float:
    """Return a number in [0, 1) (SplitMix64: Steele, Lea, Flood, OOPSLA 2014)."""
    mixed = (
        np.uint64(seed)
        + np.uint64(which) * np.uint64(0xD1342543DE82EF95)
        + np.uint64(use) * np.uint64(0x2545F4914F6CDD1D)
    )
    mixed = _mixed(mixed) + np.uint64(step) * np.uint64(0x9E3779B97F4A7C15)
    return float(_mixed(mixed) >> np.uint64(11)) * 2.0**-53


@kernel
def _mixed(value: Any) -> Any:
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@kernel
def exponential(seed: int, which: int, step: int, use: int) -> float:
    """Return a number of the exponential distribution with mean 1."""
    return -math.log(1.0 - draw(seed, which, step, use))


@kernel
def normal(seed: int, which: int, step: int, use: int) -> float:
    """Return a number of the standard normal distribution (Box and Muller)."""
    radius = math.sqrt(2.0 * exponential(seed, which, 2 * step, use))
    return radius * math.cos(2.0 * math.pi * draw(seed, which, 2 * step + 1, use))
