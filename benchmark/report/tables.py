"""The tables beside the main one, as text: metrics with numbered notes, generalization, differences."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pandas as pd

from benchmark.experiment.runs import SCRIPTED
from benchmark.metrics import METRICS
from benchmark.metrics.differences import SIGNIFICANCE
from benchmark.metrics.results import Frame
from benchmark.metrics.table import EPISODE_KEYS
from benchmark.report.content import Report
from benchmark.report.paper import algorithm_label, task_label, traffic_label
from benchmark.report.ranking import RANKED_BY
from benchmark.report.values import Key, Value, by_key, measure_conditions, p_text
from benchmark.report.wording import left_out, pairs_notes
from benchmark.results.reading import MEETS, played_in

GENERALIZATION_COLUMNS = {
    "algorithm": "Or scripted policy",
    "task": "What is driven",
    "traffic": "Social vehicles on the road",
    "seeds": "Training seeds",
    "generalization": METRICS["generalization"].meaning,
    "worst": "The held-out variation of least value, of which the rates are",
    "completion, trained": "Completion rate on unseen seeds of the training's variations",
    "completion, held out": "Completion rate on the worst held-out variation",
    "no collision, trained": "1 - collision rate on unseen seeds of the training's variations",
    "no collision, held out": "1 - collision rate on the worst held-out variation",
}
CONDITION_COLUMNS = {
    "algorithm": "Or scripted policy",
    "task": "What is driven",
    "traffic": "Social vehicles in training",
    "mode": "Action selection",
    "condition": "Of the test, or scenario",
    "completion": "Completion rate",
    "collision": "Collision rate",
    "at fault": "At-fault collision rate",
    "share that meets": "Share of agent-episodes, and of episodes, in which two ways meet within 5 s",
    "rates, meeting": "Completion and collision rate of these agent-episodes",
    "rates, not meeting": "Completion and collision rate of the others: a task without meetings is easier",
    "agent-episodes": "Of all training seeds",
    "note": "Why figures must not be averaged or compared",
}
CONDITION_RATES = (*RANKED_BY, "at_fault_collision_rate")
DIFFERENCE_COLUMNS = {
    "task": "What is driven",
    "traffic": "Social vehicles on the road",
    "metric": "What is compared",
    "first": "Minuend",
    "second": "Subtrahend",
    "difference": "First minus second",
    "95% interval": "Of the difference, before correction",
    "p": "Two-sided, that there is no difference between these checkpoints",
    "corrected p": "After Holm over all conditions, metrics and pairs of the table",
    "seeds": "Training seeds of the first and the second, - for a scripted policy",
    "interval, seeds": "Of the difference, with training seeds as the unit; three or more of each",
    "corrected p, seeds": "The same, after Holm over all that have one",
    "starts": "Distinct ones that both have played: the unit of comparison",
    "better": "Whose figure is better",
}


@dataclass(frozen=True)
class MetricsRow:
    """An algorithm in a condition and a mode."""

    algorithm: str
    task: str
    traffic: str
    mode: str
    """Mode for which a filter shows the row: a scripted policy has a row for each."""
    acting: str
    n: int
    seeds: str
    """How many training seeds, empty for a scripted policy."""
    cells: tuple[tuple[Value, list[int]] | None, ...]
    """Values with the numbers of their notes."""

    @property
    def label(self) -> str:
        """Name of the algorithm, and how many training seeds."""
        return algorithm_label(self.algorithm) + (f" ({self.seeds})" if self.seeds else "")


def metric_title(metric: str) -> str:
    """Return a metric's name, with its unit in brackets."""
    return METRICS[metric].label + (f" [{METRICS[metric].unit}]" if METRICS[metric].unit else "")


def metrics_table(report: Report) -> tuple[list[MetricsRow], list[str]]:
    """Return the rows of the table of all metrics, and its notes in the order of their numbers."""
    notes: dict[str, int] = {}
    rows = []
    for mode in report.modes:
        for task, traffic in report.columns:
            for name, is_scripted in report.names:
                cells = [_entry(report, (name, task, traffic, mode), each, notes) for each in report.metrics]
                first = report.value(name, task, traffic, mode, "completion_rate")
                if first is not None:
                    acting = SCRIPTED if is_scripted else mode
                    rows.append(
                        MetricsRow(name, task, traffic, mode, acting, first.n, first.seeds_text, tuple(cells))
                    )
    return rows, [*notes]


def _entry(
    report: Report, place: tuple[str, str, str, str], metric: str, notes: dict[str, int]
) -> tuple[Value, list[int]] | None:
    found = report.value(*place, metric)
    if found is None:
        return None
    return found, [notes.setdefault(note, len(notes) + 1) for note in found.note.split("; ") if note]


def generalization_rows(report: Report) -> list[list[str]]:
    """Return a row for each algorithm and condition in which held-out variations were played."""
    rows = []
    for name, task, traffic, found in report.generalization():
        pairs = ("train_completion", "held_out_completion", "train_non_collision", "held_out_non_collision")
        # Without a value no variation is the worst, so that those of none are shown.
        shown = [found.is_known or each.startswith("train") for each in pairs]
        raw = [f"{found.terms[x]:.2f}" if is_shown else "" for x, is_shown in zip(pairs, shown, strict=True)]
        names = [algorithm_label(name), task_label(task), traffic_label(traffic)]
        rows.append(
            [
                *names,
                str(found.seeds or ""),
                f"{found.text} {found.interval}".strip(),
                found.worst if found.is_known else "",
                *raw,
            ]
        )
    return rows


def condition_rows(report: Report) -> list[list[str]]:
    """Return a row for each policy and condition of a test, or scenario.

    A condition that is the only one has none, unless it is known which agents meet.
    """
    rows, table = [], report.results.table
    tested = table[table["split"] != "held_out"]
    for task, traffic in report.columns if len(table) else ():
        own = tested[(tested["task"] == task) & (tested["task_traffic"] == traffic)]
        played = played_in(own)
        if played.nunique() < 2 and not meets(own).notna().any():
            continue
        own = own.assign(task=played)
        values = by_key(measure_conditions(own, CONDITION_RATES))
        met = {which: by_key(measure_conditions(own[meets(own) == which], RANKED_BY)) for which in (1, 0)}
        for name, place, _, mode, metric in values:
            if metric == RANKED_BY[0]:
                rates = [values[name, place, traffic, mode, each] for each in CONDITION_RATES]
                names = [algorithm_label(name), task_label(task), traffic_label(traffic), mode, place]
                figures = [f"{rate.text} {rate.interval}".strip() for rate in rates]
                mark = report.marks.get((name, task, traffic), "")
                asked = own[(own["algorithm"] == name) & (own["mode"] == mode) & (own["task"] == place)]
                apart = [_both_rates(each, (name, place, traffic, mode)) for each in met.values()]
                rows.append([*names, *figures, meeting_shares(asked), *apart, str(rates[0].n), mark])
    return rows


def meets(table: Frame) -> Frame:
    """Return which agent-episodes meet another agent, NaN where that is not known."""
    return table[MEETS] if MEETS in table else pd.Series(math.nan, table.index)


def meeting_shares(table: Frame) -> str:
    """Return the shares of agent-episodes, and of episodes, that meet; empty if that is not known."""
    known = meets(table)[~table["is_invalid"]].dropna()
    if not len(known):
        return ""
    keys = [table.loc[known.index, name] for name in ("training_seed", *EPISODE_KEYS)]
    return f"{known.mean():.2f} / {known.groupby(keys).max().mean():.2f}"


def _both_rates(values: dict[Key, Value], place: tuple[str, str, str, str]) -> str:
    """Return completion and collision rate, empty without any."""
    rates = [values[(*place, each)].text for each in RANKED_BY if (*place, each) in values]
    return " / ".join(rates)


def difference_rows(report: Report) -> list[list[str]]:
    """Return a row for each decided pair, condition and metric of the main mode."""
    return [row for row in _differences(report) if row[-1]]


def difference_notes(report: Report) -> list[str]:
    """Return how many differences are decided in each mode, and what was left out of them."""
    said = []
    for mode in report.modes:
        found = report.differences[mode]
        decided, unknown = int((found["wins"] != "").sum()), int(found["corrected"].isna().sum())
        ties = len(found) - decided - unknown
        by_seeds = found.loc[found["wins"] != "", "seeds_corrected"].dropna()
        count = int((by_seeds < SIGNIFICANCE).sum())
        said.append(
            f"{mode.capitalize()}: {decided} differences are decided, of them with training seeds as the "
            f"unit {count} of the {len(by_seeds)} that have one; {ties} are ties, "
            f"{unknown} could not be compared."
        )
        said += [f"In some, {note}." for note in pairs_notes(found["note"])]
    return said + left_out(report)


def _differences(report: Report) -> Iterator[list[str]]:
    for row in report.differences[report.modes[0]].to_dict("records"):
        yield [
            task_label(row["task"]),
            traffic_label(row["task_traffic"]),
            METRICS[row["metric"]].label,
            algorithm_label(row["first"]),
            algorithm_label(row["second"]),
            f"{row['value']:+z.2f}" if math.isfinite(row["value"]) else "n/a",
            _ends(row["low"], row["high"]),
            *(p_text(row[name]) for name in ("p_value", "corrected")),
            _seeds(report, row),
            _ends(row["seeds_low"], row["seeds_high"]),
            p_text(row["seeds_corrected"]),
            str(row["pairs"]),
            algorithm_label(row["wins"]) if row["wins"] else "",
        ]


def _ends(low: float, high: float) -> str:
    """Return an interval of a difference as it is shown, empty without one."""
    return f"[{low:+z.2f}, {high:+z.2f}]" if math.isfinite(low) else ""


def _seeds(report: Report, row: dict[str, Any]) -> str:
    """Return the numbers of training seeds of a difference's two entries."""
    found = []
    for name in ("first", "second"):
        value = report.value(row[name], row["task"], row["task_traffic"], report.modes[0], row["metric"])
        found.append(str((value.seeds if value else 0) or "-"))
    return " / ".join(found)
