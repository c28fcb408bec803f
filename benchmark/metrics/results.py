"""Values of metrics with intervals, from a table of agent-episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.metrics.measure import Measure
from benchmark.metrics.registry import METRICS
from benchmark.metrics.table import EPISODE_KEYS, START, sums_of
from benchmark.statistics import (
    arcsine_interval,
    bootstrap_interval,
    bootstrap_totals,
    checkpoint_interval,
    design_effect,
    seed_interval,
)
from smarts.errors import SmartsError
from smarts.types.streams import Purpose, stream

Floats = NDArray[np.float64]
Bounds = tuple[float, float]
Frame = Any
"""A pandas frame; pandas' annotations do not distinguish row and column selection."""

SEED = "training_seed"
"""Column of the training seed; a table without it is of one checkpoint."""
THIS_CHECKPOINT = "this checkpoint"
FEWER_STARTS = "no interval: fewer distinct starts than episodes"
NO_SPREAD = "no interval: all episodes are alike"
_NO_BOUNDS = float("nan"), float("nan")


@dataclass(frozen=True)
class _EpisodeGroup:
    """The episodes of one value."""

    totals: Mapping[str, Floats]
    """Sums of each column in each episode, shape (K,)."""
    seeds: NDArray
    """Number of the training seed of each episode, 0 to S - 1, shape (K,)."""
    strata: NDArray
    """Number of training seed and split of each episode, shape (K,)."""
    has_repeats: bool
    """Whether a seed has fewer distinct starts than episodes."""

    @property
    def count(self) -> int:
        """S, the number of training seeds."""
        return int(self.seeds.max()) + 1 if len(self.seeds) else 0

    @cached_property
    def resampled(self) -> dict[str, Floats]:
        """Sums over episodes drawn with replacement within seed and split, shape (R,)."""
        table = np.stack([*self.totals.values()], axis=-1)
        drawn = bootstrap_totals(table, stream(0, Purpose.RESAMPLING), self.strata)
        return dict(zip(self.totals, drawn.T, strict=True))

    def by_seed(self, columns: Sequence[str]) -> dict[str, Floats]:
        """Return the sums of each seed, shape (S,)."""
        return {
            name: np.bincount(self.seeds, self.totals[name], self.count).astype(float) for name in columns
        }


def compute(table: pd.DataFrame, by: Sequence[str] = (), metrics: Sequence[str] = ()) -> pd.DataFrame:
    """Return the value of each metric in each group, with a 95% interval.

    Args:
        table: Of `measure_episodes`, joined over algorithms and training seeds as wanted. Column
            `training_seed` identifies the training seed; groups must not mix algorithms.
        by: Columns that make groups; none: one group. For generalization, not the variation or split.
        metrics: Names, by default all of whose columns the table has.

    Returns:
        A row for each group and metric: the columns of `by`, metric, value, low, high, n (agent-episodes),
        count (the denominator: how much there was to measure), counted (what that is), episodes, seeds,
        label (of the interval: "3 training seeds", "this checkpoint"), note (why there is no value or no
        interval, or which terms of an index are missing), terms (a dict, by name). NaN is n/a.

    Raises:
        SmartsError: A column of `by` is not in the table.
        UnknownNameError: A metric is unknown.
    """
    if absent := sorted({*by} - {*table.columns}):
        raise SmartsError(f"the table of results has no column '{absent[0]}'", place="compute")
    wanted = [METRICS[name] for name in metrics] or measured_in(table)
    needed = sorted(set().union(*(measure.needs for measure in wanted)))
    kept: Frame = table[~table["is_invalid"]] if len(table) else table
    rows: list[dict[str, Any]] = []
    groups = kept.groupby([*by], sort=True, dropna=False) if by else [((), kept)] if len(kept) else []
    for key, part in groups:
        group, names = _group_of(part, needed), dict(zip(by, key, strict=True))
        rows += [{**names, **_row(measure, group)} for measure in wanted]
    columns = [*by, "metric", "value", "low", "high", "n", "count", "counted"]
    columns += ["episodes", "seeds", "label", "note", "terms"]
    return pd.DataFrame.from_records(rows, columns=columns)


def measured_in(table: Frame) -> list[Measure]:
    """Return the metrics whose columns a table has."""
    return [measure for name in METRICS if {*(measure := METRICS[name]).columns} <= {*table.columns}]


def _group_of(part: Frame, columns: Sequence[str]) -> _EpisodeGroup:
    seed = part[SEED] if SEED in part else pd.Series(0, index=part.index)
    episode = [seed.rename("_seed"), *(part[name] for name in ("split", *EPISODE_KEYS))]
    names = [*dict.fromkeys(["agents", *columns])]
    sums: Frame = sums_of(part, names, episode)
    starts = pd.Series(map(tuple, part[[*START]].round(6).to_numpy()), index=part.index)
    start: Frame = starts.groupby(episode, dropna=False, sort=True).agg(tuple)
    place = ["_seed", "split", "scenario", "variation", "traffic"]
    distinct, played = start.groupby(level=place).nunique(), start.groupby(level=place).size()
    return _EpisodeGroup(
        totals={name: sums[name].to_numpy(float) for name in names},
        seeds=np.unique(sums.index.get_level_values("_seed"), return_inverse=True)[1],
        strata=sums.groupby(level=["_seed", "split"], sort=True).ngroup().to_numpy(),
        has_repeats=bool((distinct < played).any()),
    )


def _row(measure: Measure, group: _EpisodeGroup) -> dict[str, Any]:
    totals = {name: column.sum() for name, column in group.totals.items()}
    value = float(measure.known(totals))
    terms = {name: float(term) for name, term in (measure.terms(totals) if measure.terms else {}).items()}
    unknown = [name for name in measure.needs if not np.isfinite(totals[name])]
    (low, high), label, note = _NO_BOUNDS, "", ""
    if unknown:
        note = f"n/a: not every table has numbers in column '{unknown[0]}'"
    elif not np.isfinite(value):
        note = f"n/a: {measure.missing}"
    else:
        (low, high), label, reason = _bounds(measure, group)
        note = "; ".join(filter(None, (_missing(terms), reason)))
    return {
        "metric": measure.name,
        "value": value,
        "low": low,
        "high": high,
        "n": int(totals["agents"]),
        "count": float("nan") if unknown else float(measure.denominator(totals)),
        "counted": measure.counted,
        "episodes": len(group.seeds),
        "seeds": group.count,
        "label": label,
        "note": note,
        "terms": terms,
    }


def _missing(terms: Mapping[str, float]) -> str:
    names = [name for name, term in terms.items() if not np.isfinite(term)]
    return f"without {', '.join(names)}" if names else ""


def _bounds(measure: Measure, group: _EpisodeGroup) -> tuple[Bounds, str, str]:
    """Return interval and label, or why there is none."""
    if group.has_repeats:
        return _NO_BOUNDS, "", FEWER_STARTS
    (low, high), label = _interval(measure, group)
    return ((low, high), label, "") if low < high else (_NO_BOUNDS, "", NO_SPREAD)


def _interval(measure: Measure, group: _EpisodeGroup) -> tuple[Bounds, str]:
    """Return the interval over seeds where there are three, at least as wide as that over episodes."""
    by_seed = np.atleast_1d(measure.known(group.by_seed([*group.totals])))
    seeds = np.flatnonzero(np.isfinite(by_seed)).tolist()
    is_of_seeds = len(seeds) >= 3
    label = f"{len(seeds)} training seeds" if is_of_seeds else THIS_CHECKPOINT
    if measure.hits:
        low, high = _share_bounds(measure, group, seeds)
    else:
        low, high = bootstrap_interval(measure.value(group.resampled))
        if is_of_seeds:
            low_of_seeds, high_of_seeds = seed_interval(by_seed[seeds])
            low, high = np.fmin(low, low_of_seeds), np.fmax(high, high_of_seeds)
    low, high = (float(np.clip(bound, 0.0, 1.0) if measure.is_share else bound) for bound in (low, high))
    return (low, high), label


def _share_bounds(measure: Measure, group: _EpisodeGroup, seeds: Sequence[int]) -> Any:
    hits, trials = group.totals[measure.hits], measure.denominator(group.totals)
    there = trials > 0
    if len(seeds) < 3:
        return checkpoint_interval(hits[there], trials[there])
    parts = [there & (group.seeds == seed) for seed in seeds]
    rates = [hits[rows].sum() / trials[rows].sum() for rows in parts]
    counts = [trials[rows].sum() / design_effect(hits[rows], trials[rows]) for rows in parts]
    return arcsine_interval(rates, counts)
