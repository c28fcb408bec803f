"""Means over the episodes of all runners, which RLlib's own statistics would make means of means."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from ray.rllib.utils.metrics.stats import MeanStats

EPISODE_MEAN = "episode_mean"
"""Reduction of `EpisodeMean`, whose values are pairs (mean, number of episodes)."""


class EpisodeMean(MeanStats):
    """A mean that weighs what each runner reports by the number of its episodes."""

    stats_cls_identifier = EPISODE_MEAN

    def window_reduce(self, values: Iterable[tuple[float, int]] | None = None) -> list[Any]:
        """Return the mean over all episodes, as the only entry of a list (RLlib)."""
        return [_combined(self.values if values is None else values)[0]]

    def peek(self, compile: bool = True, latest_merged_only: bool = False) -> Any:
        """Return the mean so far, leaving the values as they are (RLlib)."""
        values = self.latest_merged if latest_merged_only else self.values
        reduced = self.window_reduce(values or [])
        return reduced[0] if compile else reduced

    def reduce(self, compile: bool = True) -> Any:
        """Return and clear: the mean, or statistics that can still be joined with other runners' (RLlib)."""
        values = [_combined(self.values)] if len(self.values) else []
        self._set_values([])
        if compile:
            return self.window_reduce(values)[0]
        reduced: Any = self.clone()
        reduced.values = values
        return reduced


def _combined(values: Iterable[tuple[float, int]]) -> tuple[float, int]:
    pairs = list(values)
    count = sum(number for _, number in pairs)
    return (sum(mean * number for mean, number in pairs) / count if count else np.nan), count
