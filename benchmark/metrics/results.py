"""Values of metrics with intervals, from a table of agent-episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.metrics.measure import Measure, mean_of_known
from benchmark.metrics.registry import METRICS
from benchmark.metrics.table import EPISODE_KEYS, START, sums_of
from benchmark.statistics import (
    LEVEL,
    arcsine_interval,
    bootstrap_counts,
    bootstrap_interval,
    checkpoint_interval,
    design_effect,
    seed_interval,
)
from smarts.errors import SmartsError
from smarts.types.streams import Purpose, stream

Bools = NDArray[np.bool_]
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
    """The K episodes of one value, of S training seeds."""

    totals: Mapping[str, Floats]
    """Sums of each column in each episode, shape (K,)."""
    seeds: NDArray
    """Number of the training seed of each episode, 0 to S - 1, shape (K,)."""
    strata: NDArray
    """Number of training seed and split, and of a held-out variation, of each episode, shape (K,)."""
    variations: Mapping[str, Bools]
    """Held-out variation -> its episodes and those of its scenario's training, shape (K,)."""
    has_repeats: bool
    """Whether a seed has fewer distinct starts than episodes."""

    @property
    def count(self) -> int:
        """S."""
        return int(self.seeds.max()) + 1 if len(self.seeds) else 0

    @cached_property
    def by_seed(self) -> Bools:
        """The episodes of each seed, shape (S, K)."""
        return self.seeds == np.arange(self.count)[:, None]

    @cached_property
    def drawn(self) -> Floats:
        """How often each resample has each episode, drawn within the strata, shape (R, K)."""
        return bootstrap_counts(self.strata, stream(0, Purpose.RESAMPLING))

    def sums(self, names: Sequence[str], rows: Bools, weights: Floats | None = None) -> dict[str, Floats]:
        """Return sums of columns over some episodes, with weights of shape (R, K) those of resamples."""
        kept = np.stack([self.totals[name][rows] for name in names], axis=-1)
        found = kept.sum(axis=0) if weights is None else weights[:, rows] @ kept
        return dict(zip(names, found.T, strict=True))

    def values(self, measure: Measure, rows: Bools, weights: Floats | None = None) -> dict[str, Floats]:
        """Return a metric of some episodes, or of resamples, in each part of which it takes the mean.

        Parts are held-out variations, training seeds, or there is one.
        """
        parts: dict[str, Bools] = {"": rows}
        if measure.is_by_variation:
            parts = {name: rows & own for name, own in self.variations.items()}
        elif measure.is_of_checkpoints:
            parts = {str(seed): rows & own for seed, own in enumerate(self.by_seed)}
        found = {}
        for name, part in parts.items():
            whole = self.sums(measure.needs, part)
            sums = whole if weights is None else self.sums(measure.needs, part, weights)
            is_enough = measure.denominator(whole) >= measure.least
            value = measure.of_whole(measure.enough(sums, whole))
            found[name] = np.where(is_enough, value, np.nan)
        return found

    def value(self, measure: Measure, rows: Bools, weights: Floats | None = None) -> Floats:
        """Return a metric of some episodes, a number, or of resamples, shape (R,); NaN is n/a."""
        found = self.values(measure, rows, weights)
        return mean_of_known(found) if found else np.array(np.nan)


def compute(
    table: pd.DataFrame, by: Sequence[str] = (), metrics: Sequence[str] = (), level: float = LEVEL
) -> pd.DataFrame:
    """Return the value of each metric in each group, with an interval.

    Args:
        table: Of `measure_episodes`, joined over algorithms and training seeds as wanted. Column
            `training_seed` identifies the training seed; groups must not mix algorithms.
        by: Columns that make groups; none: one group. For generalization, not the variation or split.
        metrics: Names, by default all of whose columns the table has.
        level: Confidence level of the intervals.

    Returns:
        A row for each group and metric: the columns of `by`, metric, value, low, high, n (agent-episodes),
        count (the denominator: how much there was to measure), counted (what that is), episodes, seeds,
        label (of the interval: "3 training seeds", "this checkpoint"), note (why there is no value or no
        interval, or which terms of an index are missing), terms (a dict, by name), worst (the held-out
        variation of least value, of which the terms then are). NaN is n/a.

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
        rows += [{**names, **_row(measure, group, level)} for measure in wanted]
    columns = [*by, "metric", "value", "low", "high", "n", "count", "counted"]
    columns += ["episodes", "seeds", "label", "note", "terms", "worst"]
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
    keys: Frame = sums.index.to_frame(index=False)
    is_held_out = keys["split"] == "held_out"
    held_out = (keys["scenario"] + "@" + keys["variation"]).where(is_held_out, "")
    strata: Frame = keys.assign(held_out=held_out).groupby(["_seed", "split", "held_out"], sort=True)
    return _EpisodeGroup(
        totals={name: sums[name].to_numpy(float) for name in names},
        seeds=np.unique(keys["_seed"], return_inverse=True)[1],
        strata=strata.ngroup().to_numpy(),
        variations=_variations(keys["scenario"].to_numpy(str), held_out.to_numpy(str)),
        has_repeats=bool((distinct < played).any()),
    )


def _variations(scenario: NDArray, held_out: NDArray) -> dict[str, Bools]:
    """Return the episodes of each held-out variation, with those of its scenario's training."""
    found = {}
    for name in np.unique(held_out[held_out != ""]).tolist():
        is_trained = (held_out == "") & (scenario == name.partition("@")[0])
        found[name] = is_trained | (held_out == name)
    return found


def _row(measure: Measure, group: _EpisodeGroup, level: float) -> dict[str, Any]:
    every = np.ones(len(group.seeds), np.bool_)
    totals = group.sums(measure.needs, every)
    value = float(group.value(measure, every))
    worst = _worst(measure, group, every)
    part = group.sums(measure.needs, group.variations[worst]) if worst else totals
    found = measure.terms(measure.enough(part, part)) if measure.terms else {}
    terms = {name: float(term) for name, term in found.items()}
    unknown = [name for name in measure.needs if not np.isfinite(totals[name])]
    (low, high), label, note = _NO_BOUNDS, "", ""
    if unknown:
        note = f"n/a: not every table has numbers in column '{unknown[0]}'"
    elif not np.isfinite(value):
        note = f"n/a: {measure.missing}"
    else:
        (low, high), label, reason = _bounds(measure, group, level)
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
        "worst": worst,
    }


def _worst(measure: Measure, group: _EpisodeGroup, rows: Bools) -> str:
    """Return the held-out variation of least value, "" without one."""
    found = group.values(measure, rows) if measure.is_by_variation else {}
    known = {name: float(value) for name, value in found.items() if np.isfinite(value)}
    return min(known or found, key=lambda name: known.get(name, 0.0), default="")


def _missing(terms: Mapping[str, float]) -> str:
    names = [name for name, term in terms.items() if not np.isfinite(term)]
    return f"without {', '.join(names)}" if names else ""


def _bounds(measure: Measure, group: _EpisodeGroup, level: float) -> tuple[Bounds, str, str]:
    """Return interval and label, or why there is none."""
    if group.has_repeats:
        return _NO_BOUNDS, "", FEWER_STARTS
    (low, high), label = _interval(measure, group, level)
    return ((low, high), label, "") if low < high else (_NO_BOUNDS, "", NO_SPREAD)


def _interval(measure: Measure, group: _EpisodeGroup, level: float) -> tuple[Bounds, str]:
    """Return the interval over seeds where there are three, at least as wide as that over episodes."""
    by_seed = np.array([float(group.value(measure, rows)) for rows in group.by_seed])
    seeds = np.flatnonzero(np.isfinite(by_seed)).tolist()
    is_of_seeds = len(seeds) >= 3
    label = f"{len(seeds)} training seeds" if is_of_seeds else THIS_CHECKPOINT
    if measure.hits:
        low, high = _share_bounds(measure, group, seeds, level)
    else:
        every = np.ones(len(group.seeds), np.bool_)
        low, high = bootstrap_interval(group.value(measure, every, group.drawn), level)
        if is_of_seeds:
            low_of_seeds, high_of_seeds = seed_interval(by_seed[seeds], level)
            low, high = np.fmin(low, low_of_seeds), np.fmax(high, high_of_seeds)
    low, high = (float(np.clip(bound, 0.0, 1.0) if measure.is_share else bound) for bound in (low, high))
    return (low, high), label


def _share_bounds(measure: Measure, group: _EpisodeGroup, seeds: Sequence[int], level: float) -> Any:
    hits, trials = group.totals[measure.hits], measure.denominator(group.totals)
    there = trials > 0
    if len(seeds) < 3:
        return checkpoint_interval(hits[there], trials[there], level)
    parts = [there & (group.seeds == seed) for seed in seeds]
    rates = [hits[rows].sum() / trials[rows].sum() for rows in parts]
    counts = [trials[rows].sum() / design_effect(hits[rows], trials[rows]) for rows in parts]
    return arcsine_interval(rates, counts, level)
