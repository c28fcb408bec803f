"""Whether social vehicles matter in a condition: naive driving collides with them, and agents meet them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from benchmark.experiment.models import EMPTY_ROADS
from benchmark.metrics.results import Frame
from benchmark.metrics.table import EPISODE_KEYS
from benchmark.results.reading import Results, RunResult
from benchmark.statistics import Difference, paired_difference

RULE_BASED = "gap_acceptance"
NAIVE = ("keep_lane", "random")
"""Drivers of which one has to collide more often than without social vehicles."""
LEAST_DIFFERENCE, MOST_P = 0.10, 0.01
"""Least difference of the naive driver's collision rates, and its largest p-value."""
LEAST_SHARE = 0.8
"""Least share of the rule-based driver's agent-episodes that meet social vehicles."""
MET = "met_social"
VERDICTS = {True: "passes", False: "FAILS", None: "not known"}
ENDS = ("off_road", "off_route", "missed_goal", "not_moving", "time_out")
"""Outcomes in the table of scores beside collision and completion."""


@dataclass(frozen=True)
class TrafficCheck:
    """Verdict on one condition with social vehicles."""

    task: str
    traffic: str
    differences: dict[str, Difference]
    """Naive driver -> its collision rate minus that on empty roads, paired by episode."""
    share: float
    """Share of the rule-based driver's agent-episodes with a social vehicle; NaN if that is not known."""

    @property
    def collides(self) -> bool | None:
        """Whether a naive driver collides more often; None if those that were played do not tell."""
        found = {_is_large(each) for each in self.differences.values()}
        if True in found:
            return True
        return False if found == {False} and self.differences.keys() == {*NAIVE} else None

    @property
    def meets(self) -> bool | None:
        """Whether the rule-based driver meets social vehicles; None if that is not known."""
        return self.share >= LEAST_SHARE if math.isfinite(self.share) else None

    @property
    def passes(self) -> bool | None:
        """Whether both hold; None if that is not known."""
        found = {self.collides, self.meets}
        return False if False in found else None if None in found else True

    def __str__(self) -> str:
        differences = ", ".join(
            f"{name} {each.value:+z.2f} ({_shown_p(each)})" for name, each in self.differences.items()
        )
        share = f"{self.share:.2f}" if math.isfinite(self.share) else "not measured"
        return (
            f"{self.task}, {self.traffic}: {VERDICTS[self.passes]}; collisions against empty roads: "
            f"{differences or 'not played'}; {RULE_BASED} meets social vehicles in: {share}"
        )


def traffic_checks(results: Results) -> list[TrafficCheck]:
    """Return the check of each condition with social vehicles and a scripted policy, played yet or not."""
    tables = _tables(results)
    cells = dict.fromkeys(
        (run.task, run.traffic) for run in results.runs if run.is_scripted and run.traffic != EMPTY_ROADS
    )
    found = []
    for task, traffic in cells:
        both = {name: [tables.get((name, task, each)) for each in (traffic, EMPTY_ROADS)] for name in NAIVE}
        differences = {
            name: _difference(social, empty)
            for name, (social, empty) in both.items()
            if social is not None and empty is not None
        }
        rows = tables.get((RULE_BASED, task, traffic))
        share = float(rows[MET].mean()) if rows is not None and MET in rows else math.nan
        found.append(TrafficCheck(task, traffic, differences, share))
    return found


def score_table(results: Results) -> str:
    """Return outcomes, durations and returns of all scripted policies as a Markdown table."""
    lines = [
        "| task | traffic | policy | collision | completion | other ends | duration [s] | return |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (policy, task, traffic), rows in sorted(_tables(results).items(), key=lambda item: item[0][1:]):
        shares = {name: rows[f"ended_{name}"].mean() for name in ENDS if f"ended_{name}" in rows}
        others = ", ".join(f"{name} {share:.2f}" for name, share in shares.items() if share >= 0.005)
        lines.append(
            f"| {task} | {traffic} | {policy} | {rows['collisions'].mean():.2f} | {rows['goals'].mean():.2f}"
            f" | {others} | {_mean(rows, 'seconds', '.1f')} | {_mean(rows, 'return', '+.2f')} |"
        )
    return "\n".join(lines)


def _tables(results: Results) -> dict[tuple[str, str, str], Frame]:
    """Return the counted agent-episodes of each finished scripted test, by policy, task and traffic."""
    runs = [run for run in results.finished if run.is_scripted]
    return {(run.algorithm, run.task, run.traffic): _counted(run) for run in runs}


def _counted(run: RunResult) -> Frame:
    """Return the agent-episodes of a test that are neither invalid nor held out."""
    table: Frame = run.table
    return table[(table["split"] != "held_out") & ~table["is_invalid"] & (table["agents"] > 0)]


def _difference(social: Frame, empty: Frame) -> Difference:
    """Return the mean difference in collisions over the episodes that both played, whatever their traffic."""
    keys = [name for name in EPISODE_KEYS if name != "traffic"]
    first, second = (table.groupby(keys)["collisions"].mean() for table in (social, empty))
    return paired_difference((first - second).dropna().to_numpy(float), is_share_of_counts=True)


def _is_large(difference: Difference) -> bool | None:
    """Return whether collisions are as much more frequent as asked for; None if the episodes do not tell."""
    if difference.value >= LEAST_DIFFERENCE and difference.p_value < MOST_P:
        return True
    return False if difference.high < LEAST_DIFFERENCE else None


def _shown_p(difference: Difference) -> str:
    p_value = difference.p_value
    known = "no p" if p_value != p_value else "p < 0.001" if p_value < 0.001 else f"p = {p_value:.3f}"
    return f"{known}, {difference.pairs} episodes"


def _mean(rows: Frame, column: str, how: str) -> str:
    return format(rows[column].mean(), how) if column in rows else "n/a"
