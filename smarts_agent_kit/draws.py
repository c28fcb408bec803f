"""Random numbers of agents: functions of a seed and a step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def uniform(seeds: NDArray[np.uint64], step: Any, count: int) -> NDArray[np.float64]:
    """Return numbers in [0, 1) of several streams at one of their steps, shape (N, count).

    Each number is a function of its row's seed and step alone (SplitMix64: Steele, Lea, Flood, "Fast
    splittable pseudorandom number generators", OOPSLA 2014), so a row of a batch equals the row alone.

    Args:
        seeds: One per stream, shape (N,).
        step: Step of each stream, shape (N,) or one.
        count: Numbers of each stream.
    """
    places = np.asarray(step, np.uint64)[..., None] * np.uint64(count) + np.arange(
        1, count + 1, dtype=np.uint64
    )
    mixed = np.asarray(seeds, np.uint64)[:, None] + places * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((mixed ^ (mixed >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) * 2.0**-53
