"""The comparisons that an experiment's `contrasts` fixes: by training seeds, corrected for their number."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from benchmark.experiment.models import Contrasts
from benchmark.metrics import METRICS
from benchmark.metrics.differences import SIGNIFICANCE
from benchmark.metrics.results import Frame
from benchmark.metrics.table import sums_of
from benchmark.report.content import Report
from benchmark.report.paper import algorithm_label, task_label, traffic_label
from benchmark.report.ranking import CONDITION, Floats, welch
from benchmark.report.values import p_text
from benchmark.results.reading import CONDITION as NAME
from benchmark.statistics import holm
from smarts.registry import file_name
from smarts.types.streams import Purpose, stream

GAPS = (0.05, 0.10)
"""True differences whose power is reported."""
REPEATS = 2000
"""Simulated experiments for each power."""
COLUMNS = {
    "first": "Minuend",
    "second": "Subtrahend",
    "task": "What is driven",
    "traffic": "Social vehicles on the road",
    "difference": "Of the means over training seeds",
    "95% interval": "Welch's, of this difference alone",
    "p": "Two-sided, that further seeds would not differ",
    "corrected p": "After Holm over all contrasts; what is unfinished counts as 1",
    "seeds": "Training seeds of the first and the second",
    **{f"power {gap:g}": f"Chance that a true difference of {gap:g} is found" for gap in GAPS},
}
NOTE = (
    "{label} of each training seed, mean over {conditions}. Welch's t-test with training seeds as the unit, "
    "corrected after Holm over all rows, unfinished ones included. Power: the share of 2,000 simulated "
    "experiments with normally distributed seeds of the spread that is seen, and this true difference, "
    "whose p is below {level:g} divided by their number, the strictest that Holm asks for."
)
NO_SPREAD = "no spread"
"""In place of the interval where the training seeds of each side are equal."""
NEW = " They are NOT those of the first command of these results: what it found may have chosen them."
OTHER = " A later command has other contrasts, or none; they are not shown."


@dataclass(frozen=True)
class Contrast:
    """One comparison in a task with one traffic."""

    first: str
    second: str
    place: tuple[str, str]
    """Task and traffic."""
    seeds: tuple[Floats, Floats]
    """Values of each training seed of either, shape (S,)."""

    @property
    def p_value(self) -> float:
        """Two-sided p-value, NaN with fewer than two seeds of either, or without any spread."""
        if min(map(len, self.seeds)) < 2:
            return math.nan
        found = welch(*self.seeds)
        return 2.0 * float(stdtr(found.freedom, -abs(found.value) / found.error)) if found.error else math.nan


def contrasts_of(report: Report) -> list[Contrast]:
    """Return the contrasts that an experiment has fixed, finished or not, in each task and traffic."""
    given, table = report.results.contrasts, report.results.table
    if given is None or NAME not in table:
        return []
    none = np.zeros(0)
    values = _of_seeds(table[table["mode"] == report.modes[0]], given)
    values = {key: each for key, each in values.items() if (key[2], *key[:2]) not in report.unlike}
    return [
        Contrast(
            first, second, place, (values.get((*place, first), none), values.get((*place, second), none))
        )
        for place in report.results.contrasted
        for first, second in (map(file_name, pair) for pair in given.pairs)
    ]


def _of_seeds(table: Frame, given: Contrasts) -> dict[tuple[str, str, str], Floats]:
    """Return the values of training seeds that have finished all conditions, by task, traffic, algorithm."""
    measure = METRICS[given.metric]
    named = table[NAME].astype(str).str.removesuffix(" (seen)")
    kept: Frame = table[named.isin(given.conditions) & ~table["is_invalid"]]
    keys = [*CONDITION, "algorithm", "training_seed"]
    sums = sums_of(kept, measure.needs, [*(kept[key] for key in keys), named[kept.index]])
    value = measure.of_whole({name: sums[name].to_numpy(float) for name in sums})
    by_condition = sums.assign(value=value)["value"].unstack().reindex(columns=[*given.conditions])
    means = by_condition.dropna().mean(axis=1)
    return {place: each.to_numpy(float) for place, each in means.groupby(keys[:3])}


def power(seeds: Sequence[Floats], gap: float, level: float) -> float:
    """Return the share of simulated experiments in which a difference is found.

    Args:
        seeds: Values of each training seed of two algorithms, of whose spread and number the simulated are.
        gap: True difference.
        level: Largest p-value that counts.
    """
    draws = stream(0, Purpose.RESAMPLING)
    sides = [draws.normal(0.0, each.std(ddof=1), (REPEATS, len(each))) for each in seeds]
    value = sides[0].mean(axis=1) - sides[1].mean(axis=1) + gap
    parts = np.stack([each.var(axis=1, ddof=1) / each.shape[1] for each in sides])
    least = np.array([[len(each) - 1] for each in seeds])
    freedom = parts.sum(axis=0) ** 2 / (parts**2 / least).sum(axis=0)
    return float((2.0 * stdtr(freedom, -abs(value) / np.sqrt(parts.sum(axis=0))) < level).mean())


def contrast_rows(report: Report) -> Iterator[list[str]]:
    """Yield a row for each contrast, with `COLUMNS`."""
    contrasts = contrasts_of(report)
    corrected = holm([1.0 if math.isnan(each.p_value) else each.p_value for each in contrasts])
    for each, p_value in zip(contrasts, corrected, strict=True):
        names = [algorithm_label(each.first), algorithm_label(each.second)]
        names += [task_label(each.place[0]), traffic_label(each.place[1])]
        counts = " / ".join(str(len(side)) for side in each.seeds)
        found = welch(*each.seeds) if min(map(len, each.seeds)) > 1 else None
        if found is None or not found.error:
            texts = [f"{found.value:+z.2f}", NO_SPREAD] if found else [""] * 2
            yield [*names, *texts, *[""] * 2, counts, *[""] * len(GAPS)]
            continue
        ends = [f"{found.value + side * found.reach():+z.2f}" for side in (-1, 1)]
        powers = [power(each.seeds, gap, SIGNIFICANCE / len(contrasts)) for gap in GAPS]
        texts = [f"{found.value:+z.2f}", f"[{', '.join(ends)}]", p_text(each.p_value), p_text(float(p_value))]
        yield [*names, *texts, counts, *(f"{share:.2f}" for share in powers)]


def contrast_note(report: Report, given: Contrasts) -> str:
    """Return what the table of contrasts says, in words."""
    said = {"label": METRICS[given.metric].label, "conditions": ", ".join(given.conditions)}
    note = NOTE.format(**said, level=SIGNIFICANCE) + NEW * report.results.has_new_contrasts
    return note + OTHER * report.results.has_other_contrasts
