"""Paired comparisons of algorithms at equal starts, with p-values corrected for their number."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from benchmark.metrics.measure import Measure
from benchmark.metrics.registry import METRICS
from benchmark.metrics.results import Floats, Frame
from benchmark.metrics.table import EPISODE_KEYS, START, sums_of
from benchmark.statistics import holm, paired_difference

SIGNIFICANCE = 0.05
"""Corrected p-value below which a difference is no tie."""
PLACE = ("scenario", "variation", "traffic")
"""Columns within which equal starts are one start."""
_STARTS = "_starts"


def compare(
    table: pd.DataFrame,
    metrics: Sequence[str],
    by: Sequence[str] = (),
    column: str = "algorithm",
    *,
    family: Sequence[str] | None = None,
    apart: Collection[str] = (),
) -> pd.DataFrame:
    """Return differences between all pairs of algorithms at the starts that both have played.

    The unit is a distinct start: an algorithm has one value there, of all its training seeds, however many
    it has, and of all episodes that begin alike. So the answer is about these checkpoints. Starts that only
    one has played, or at which one has nothing to measure, are left out, and so are episodes of one name
    that begin differently; `note` counts them.

    Args:
        table: Of several algorithms.
        metrics: Names.
        by: Columns that make groups, such as scenario and traffic.
        column: Name of the algorithm column.
        family: Columns of the answer within which p-values are corrected after Holm; by default a metric in
            a group, none for the whole answer.
        apart: Algorithms whose differences from others are a family of their own, and among each other none.

    Returns:
        A row for each group, metric and pair: the columns of `by`, metric, first, second, value (first -
        second), low, high, p_value, pairs (starts), note, corrected (p-value, NaN if they could not be
        compared), wins: the better one's name, "" for a tie or if they could not be compared.
    """
    rows: list[dict[str, Any]] = []
    kept: Frame = table[~table["is_invalid"]]
    for key, part in kept.groupby([*by], sort=True) if by else [((), kept)]:
        begun = _with_starts(part, column)
        for measure in [METRICS[name] for name in metrics]:
            values = _values_by_start(begun, measure, column)
            for first, second in itertools.combinations(sorted(values), 2):
                if first in apart and second in apart:
                    continue
                gaps, note = _gaps(values[first], values[second])
                found = asdict(paired_difference(gaps, bool(measure.hits)))
                names = {"metric": measure.name, "first": first, "second": second}
                rows.append({**dict(zip(by, key, strict=True)), **names, **found, "note": note})
    names = [*by, "metric", "first", "second", "value", "low", "high", "p_value", "pairs", "note"]
    answer = pd.DataFrame.from_records(rows, columns=names)
    answer["corrected"] = _corrected(answer, [*by, "metric"] if family is None else family, apart)
    answer["wins"] = [_winner(row) for row in answer.to_dict("records")]
    return answer


def _with_starts(table: Frame, column: str) -> Frame:
    """Return a table with the starts of all agents of each episode, in one column."""
    seed = ["training_seed"] if "training_seed" in table else []
    mode = ["mode"] if "mode" in table else []
    table = table.sort_values("agent", kind="stable")
    own: Frame = pd.Series(map(tuple, table[[*START]].round(6).to_numpy()), index=table.index)
    keys = [column, *seed, *mode, *EPISODE_KEYS]
    numbers = table.groupby(keys, dropna=False, sort=False).ngroup()
    starts = own.groupby(numbers).agg(tuple)
    return table.assign(**{_STARTS: pd.factorize(starts)[0][numbers.to_numpy()]})


def _values_by_start(part: Frame, measure: Measure, column: str) -> dict[Any, Frame]:
    """Return a metric's values by algorithm; the index is episode and starts, values are of all seeds."""
    keys = [column, *EPISODE_KEYS, _STARTS]
    sums: Frame = sums_of(part, measure.needs, [part[key] for key in keys])
    value = measure.of_whole({name: sums[name].to_numpy(float) for name in sums})
    values: Frame = pd.Series(value, index=sums.index)
    return {name: values.xs(name, level=column) for name in values.index.unique(column)}


def _gaps(first: Frame, second: Frame) -> tuple[Floats, str]:
    """Return the differences at distinct starts, and what was left out, in words."""
    one, other = first.align(second, join="inner")
    gap = (one - other).dropna()
    units: Floats = gap.groupby([*PLACE, _STARTS]).mean().to_numpy(float)
    episodes = [each.index.droplevel(_STARTS) for each in (first, second)]
    both = episodes[0].intersection(episodes[1])
    counts = {
        "played by one only": len(episodes[0].symmetric_difference(episodes[1])),
        "with other starts": len(both) - len(one.index.droplevel(_STARTS).unique()),
        "with nothing to measure": len(one) - len(gap),
        "with the start of another": len(gap) - len(units),
    }
    return units, ", ".join(f"{count} episodes {why}" for why, count in counts.items() if count)


def _corrected(answer: Frame, family: Sequence[str], apart: Collection[str]) -> Floats:
    is_apart = answer["first"].isin([*apart]) | answer["second"].isin([*apart])
    corrected = np.full(len(answer), np.nan)
    for rows in answer.groupby([*family, is_apart], sort=False).indices.values():
        corrected[rows] = holm(answer["p_value"].to_numpy(float)[rows])
    return corrected


def _winner(row: Mapping[str, Any]) -> str:
    better = METRICS[row["metric"]].better
    if better is None or not row["corrected"] < SIGNIFICANCE:
        return ""
    return row["first"] if (row["value"] > 0) == (better == "higher") else row["second"]
