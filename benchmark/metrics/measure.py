"""What a metric is: columns for each agent-episode, and a value of their sums."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.metrics.episode_data import EpisodeData

Floats = NDArray[np.float64]
Columns = Mapping[str, NDArray]
"""A number for each agent of an episode, shape (A,), by name."""
Totals = Mapping[str, NDArray]
"""Sums of columns over agent-episodes, all of one shape: of one group, of each seed, of each resample."""


@dataclass(frozen=True)
class Measure:
    """One metric.

    What it writes are sums and counts, so that any set of agent-episodes has its value by adding up: values
    of groups, seeds and resampled episodes are all `value(totals)`. A column of one name is the same number
    whichever metric writes it. `agents`, 1 for each agent that took part, is always there.
    """

    name: str
    """As in the registry."""
    label: str
    """For people."""
    meaning: str
    """One sentence for reports."""
    columns: tuple[str, ...]
    """That `measure` writes."""
    measure: Callable[[EpisodeData], Columns]
    """Returns the columns of one episode; those of agents that took no part do not count."""
    value: Callable[[Totals], Floats]
    """Returns the metric, NaN where there is nothing to measure."""
    missing: str
    """Why there may be nothing to measure."""
    better: Literal["higher", "lower"] | None = None
    """Which way; None: it describes."""
    unit: str = ""
    is_share: bool = True
    """Whether it lies in [0, 1], and its interval is cut to that."""
    is_axis: bool = False
    """Whether it is one of the radar's axes."""
    count: tuple[str, ...] = ("agents",)
    """Columns that add up to the denominator: how much there was to measure."""
    counted: str = "agent-episodes"
    """What that counts, for people."""
    least: float = 0.0
    """Denominator below which a group has no value; single starts are compared whatever they have."""
    hits: str = ""
    """Column of the numerator where the value is a share of counted things, and so has Wilson's interval."""
    terms: Callable[[Totals], Mapping[str, Floats]] | None = None
    """What it consists of. NaN is a term that is not defined; the value is flagged then."""

    def known(self, totals: Totals) -> Floats:
        """Return the metric, NaN also where there was less than `least` to measure."""
        return np.where(self.denominator(totals) >= self.least, self.of_whole(totals), np.nan)

    def of_whole(self, totals: Totals) -> Floats:
        """Return the metric, NaN where a column's sum is NaN: also of an index that does without a term."""
        sums = [totals[name] for name in self.needs]
        return np.where(np.isfinite(sums).all(axis=0), self.value(totals), np.nan)

    @property
    def needs(self) -> tuple[str, ...]:
        """Columns without which there is no value."""
        return tuple(dict.fromkeys(("agents", *self.columns, *self.count)))

    def denominator(self, totals: Totals) -> Floats:
        """Return how much there was to measure."""
        return np.sum([totals[name] for name in self.count], axis=0)


def share(part: ArrayLike, whole: ArrayLike) -> Floats:
    """Return part / whole, NaN where the whole is 0."""
    part, whole = np.asarray(part, float), np.asarray(whole, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(whole > 0, part / whole, np.nan)


def mean_of_known(values: Mapping[str, Floats]) -> Floats:
    """Return the mean of the terms that are defined, NaN without any."""
    table = np.stack([np.asarray(each, float) for each in values.values()])
    known = np.isfinite(table)
    return share(np.where(known, table, 0.0).sum(axis=0), known.sum(axis=0))


def ended_by(episode: EpisodeData, outcome: int) -> Floats:
    """Return 1 for each agent that took part and ended that way, else 0, shape (A,)."""
    return (episode.entered & (episode.agents["outcome"] == outcome)).astype(float)
