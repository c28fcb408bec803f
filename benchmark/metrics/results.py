"""What a table of agent-episodes tells: values with intervals, and who is better than whom."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.metrics.measure import Measure
from benchmark.metrics.registry import METRICS
from benchmark.metrics.table import EPISODE_KEYS
from benchmark.statistics import (
    arcsine_interval,
    checkpoint_interval,
    design_effect,
    holm,
    paired_difference,
    resampled_totals,
    sampled_interval,
    seed_interval,
)
from smarts.errors import SmartsError
from smarts.types.streams import Purpose, stream

Floats = NDArray[np.float64]
Bounds = tuple[float, float]
Frame = Any
"""A pandas frame; its annotations do not tell a selection of rows from one of columns."""

SEED = "training_seed"
"""Column of the training seed; a table without it is of one checkpoint."""
THIS_CHECKPOINT = "this checkpoint"
FEWER_STARTS = "no interval: fewer distinct starts than episodes"
_NO_BOUNDS = float("nan"), float("nan")


@dataclass(frozen=True)
class _Group:
    """The episodes that a value is made of."""

    totals: Mapping[str, Floats]
    """Sums of each column in each episode, shape (K,)."""
    seeds: NDArray
    """Number of the training seed of each episode, 0 to S - 1, shape (K,)."""
    has_repeats: bool
    """Whether a seed has fewer distinct starts than episodes."""

    @property
    def count(self) -> int:
        """S, the number of training seeds."""
        return int(self.seeds.max()) + 1 if len(self.seeds) else 0

    @cached_property
    def resampled(self) -> dict[str, Floats]:
        """Sums over episodes drawn with replacement, shape (R,)."""
        table = np.stack([*self.totals.values()], axis=-1)
        drawn = resampled_totals(table, stream(0, Purpose.RESAMPLING))
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
            `training_seed` tells training seeds apart; groups must not mix algorithms.
        by: Columns that make groups; none: one group. For generalization, not the variation or split.
        metrics: Names, by default all of whose columns the table has.

    Returns:
        A row for each group and metric: the columns of `by`, metric, value, low, high, n (agent-episodes),
        episodes, seeds, label (of the interval: "3 training seeds", "this checkpoint"), note (why there is no
        value or no interval, or which terms of an index are missing), terms (a dict, by name). NaN is n/a.

    Raises:
        SmartsError: A column of `by` is not in the table.
        UnknownNameError: A metric is unknown.
    """
    absent = [name for name in by if name not in table.columns]
    if absent:
        raise SmartsError(f"the table of results has no column '{absent[0]}'", place="compute")
    wanted = [METRICS[name] for name in metrics or METRICS]
    if not metrics:
        wanted = [measure for measure in wanted if set(measure.columns) <= set(table.columns)]
    kept: Frame = table[~table["is_void"]] if len(table) else table
    rows: list[dict[str, Any]] = []
    groups = kept.groupby([*by], sort=True, dropna=False) if by else [((), kept)]
    for key, part in groups:
        group = _group_of(part, sorted({name for measure in wanted for name in measure.columns}))
        names = dict(zip(by, key, strict=True))
        rows += [{**names, **_row(measure, group)} for measure in wanted] if len(part) else []
    columns = [*by, "metric", "value", "low", "high", "n", "episodes", "seeds", "label", "note", "terms"]
    return pd.DataFrame.from_records(rows, columns=columns)


def _group_of(part: Frame, columns: Sequence[str]) -> _Group:
    seed = part[SEED] if SEED in part else pd.Series(0, index=part.index)
    episode = [seed.rename("_seed"), *(part[name] for name in ("split", *EPISODE_KEYS))]
    names = [*dict.fromkeys(["agents", *columns])]
    sums: Frame = part[names].groupby(episode, dropna=False, sort=True).sum()
    names_of_start = ["start_x", "start_y", "start_heading", "start_speed"]
    starts = pd.Series(map(tuple, part[names_of_start].round(6).to_numpy()), index=part.index)
    start: Frame = starts.groupby(episode, dropna=False, sort=True).agg(tuple)
    place = ["_seed", "split", "scenario", "variation", "traffic"]
    distinct, played = start.groupby(level=place).nunique(), start.groupby(level=place).size()
    return _Group(
        totals={name: sums[name].to_numpy(float) for name in names},
        seeds=np.unique(sums.index.get_level_values("_seed"), return_inverse=True)[1],
        has_repeats=bool((distinct < played).any()),
    )


def _row(measure: Measure, group: _Group) -> dict[str, Any]:
    totals = {name: column.sum() for name, column in group.totals.items()}
    value = float(measure.value(totals))
    terms = {name: float(term) for name, term in (measure.terms(totals) if measure.terms else {}).items()}
    (low, high), label, note = _NO_BOUNDS, "", ""
    if not np.isfinite(value):
        note = f"n/a: {measure.missing}"
    else:
        missing = [name for name, term in terms.items() if not np.isfinite(term)]
        note = f"without {', '.join(missing)}" if missing and measure.kind == "index" else ""
        if group.has_repeats:
            note = "; ".join(filter(None, (note, FEWER_STARTS)))
        else:
            (low, high), label = _interval(measure, group)
    return {
        "metric": measure.name,
        "value": value,
        "low": low,
        "high": high,
        "n": int(totals["agents"]),
        "episodes": len(group.seeds),
        "seeds": group.count,
        "label": label,
        "note": note,
        "terms": terms,
    }


def _interval(measure: Measure, group: _Group) -> tuple[Bounds, str]:
    names = [*group.totals]
    by_seed = np.atleast_1d(measure.value(group.by_seed(names)))
    known = np.isfinite(by_seed)
    label = f"{known.sum()} training seeds" if known.sum() >= 3 else THIS_CHECKPOINT
    if measure.rate:
        bounds = _rate_bounds(measure.rate, group, known)
    elif known.sum() >= 3:
        bounds = seed_interval(by_seed[known])
    else:
        bounds = sampled_interval(measure.value(group.resampled))
    low, high = (float(np.clip(bound, 0.0, 1.0) if measure.is_share else bound) for bound in bounds)
    return (low, high), label


def _rate_bounds(rate: tuple[str, str], group: _Group, known: NDArray[np.bool_]) -> Any:
    hits, trials = (group.totals[name] for name in rate)
    played = trials > 0
    if known.sum() < 3:
        return checkpoint_interval(hits[played], trials[played])
    seeds = [played & (group.seeds == seed) for seed in np.flatnonzero(known).tolist()]
    rates = [hits[rows].sum() / trials[rows].sum() for rows in seeds]
    counts = [trials[rows].sum() / design_effect(hits[rows], trials[rows]) for rows in seeds]
    return arcsine_interval(rates, counts)


def compare(
    table: pd.DataFrame, metrics: Sequence[str], by: Sequence[str] = (), column: str = "algorithm"
) -> pd.DataFrame:
    """Return paired differences between all pairs of algorithms, Holm-corrected over the whole answer.

    Episodes are paired by `EPISODE_KEYS` and training seed; one that only one of the two has played, or in
    which one of them has nothing to measure, is left out.

    Args:
        table: Of several algorithms.
        metrics: Names.
        by: Columns that make groups, such as scenario and traffic.
        column: That tells the algorithms apart.

    Returns:
        A row for each group, metric and pair: the columns of `by`, metric, first, second, value (first -
        second), low, high, p_value, pairs, corrected (p-value), wins: the better one's name, "" for a tie.
    """
    rows: list[dict[str, Any]] = []
    kept: Frame = table[~table["is_void"]]
    for key, part in kept.groupby([*by], sort=True) if by else [((), kept)]:
        for measure in [METRICS[name] for name in metrics]:
            values = _values_by_start(part, measure, column)
            for first, second in itertools.combinations(sorted(values), 2):
                one, other = values[first].align(values[second], join="inner")
                found = asdict(paired_difference(one.to_numpy(float), other.to_numpy(float)))
                names = {"metric": measure.name, "first": first, "second": second}
                rows.append({**dict(zip(by, key, strict=True)), **names, **found})
    names = [*by, "metric", "first", "second", "value", "low", "high", "p_value", "pairs"]
    answer = pd.DataFrame.from_records(rows, columns=names)
    answer["corrected"] = holm(answer["p_value"].to_numpy(float))
    answer["wins"] = [_winner(row) for row in answer.to_dict("records")]
    return answer


def _values_by_start(part: Frame, measure: Measure, column: str) -> dict[Any, Frame]:
    """Return a metric's value in each episode, by algorithm: row = training seed, column = start."""
    part = part if SEED in part else part.assign(**{SEED: 0})
    keys = [column, SEED, *EPISODE_KEYS]
    sums = part.groupby(keys, sort=True)[[*dict.fromkeys(["agents", *measure.columns])]].sum()
    value = measure.value({name: sums[name].to_numpy(float) for name in sums})
    values: Frame = pd.Series(value, index=sums.index).unstack(list(EPISODE_KEYS))
    return {name: values.xs(name, level=column) for name in values.index.unique(column)}


def _winner(row: Mapping[str, Any]) -> str:
    better = METRICS[row["metric"]].better
    if better is None or not row["corrected"] < 0.05:
        return ""
    return row["first"] if (row["value"] > 0) == (better == "higher") else row["second"]
