"""`Measure`, a metric: columns for each agent-episode, and a value of their sums."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

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

    Columns are sums and counts, so the value of any set of agent-episodes is `value(totals)` of their sums:
    of groups, seeds and resampled episodes. Metrics may share a column if they write the same numbers. Column
    `agents`, 1 for each agent that took part, always exists.
    """

    name: str
    """As in the registry."""
    label: str
    """Shown in reports."""
    meaning: str
    """One sentence for reports."""
    columns: tuple[str, ...]
    """Written by `measure`."""
    measure: Callable[[EpisodeData], Columns]
    """Returns the columns of one episode; values of agents that took no part are ignored."""
    value: Callable[[Totals], Floats]
    """Returns the metric, NaN where there is nothing to measure."""
    missing: str
    """Why there may be nothing to measure."""
    better: Literal["higher", "lower"] | None = None
    """Direction of improvement; None for a descriptive metric."""
    unit: str = ""
    is_share: bool = True
    """Whether it lies in [0, 1], and its interval is cut to that."""
    is_axis: bool = False
    """Whether it is one of the radar's axes."""
    count: tuple[str, ...] = ("agents",)
    """Columns that add up to the denominator: how much there was to measure."""
    counted: str = "agent-episodes"
    """Unit of that count, shown in reports."""
    least: float = 0.0
    """Denominator below which a group has no value; single starts are compared whatever they have."""
    scarce: tuple[str, ...] = ()
    """Denominators of terms, each of which has to reach `least` for its term to be defined."""
    hits: str = ""
    """Column of the numerator where the value is a share of counted things, and so has Wilson's interval."""
    terms: Callable[[Totals], Mapping[str, Floats]] | None = None
    """Terms of an index. NaN is an undefined term, which the value's note names."""
    is_of_checkpoints: bool = False
    """Whether the value of several training seeds is the mean of their values, not the value of all sums."""
    is_by_variation: bool = False
    """Whether the value is the mean of those of each held-out variation, and the worst one is named."""

    def known(self, totals: Totals) -> Floats:
        """Return the metric, NaN also where there was less than `least` to measure."""
        enough = self.enough(totals, totals)
        return np.where(self.denominator(totals) >= self.least, self.of_whole(enough), np.nan)

    def enough(self, totals: Totals, whole: Totals) -> Totals:
        """Return sums with 0 for each of the `scarce` denominators that is below `least` in `whole`."""
        kept = {name: np.where(whole[name] >= self.least, totals[name], 0.0) for name in self.scarce}
        return {**totals, **kept}

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


def ratio(
    part: str, whole: str = "agents", *, columns: tuple[str, ...] = (), is_count: bool = False, **given: Any
) -> Measure:
    """Return the metric `part / whole` of two columns.

    Args:
        part: Column of the numerator.
        whole: Column of the denominator.
        columns: Further columns that `measure` writes.
        is_count: Whether the part counts some of what the whole counts, which gives it Wilson's interval.
        given: All other fields of `Measure`.
    """
    own = [name for name in (part, whole) if name != "agents"]
    return Measure(
        columns=(*own, *columns),
        value=lambda totals: share(totals[part], totals[whole]),
        count=(whole,),
        hits=part if is_count else "",
        **given,
    )


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
