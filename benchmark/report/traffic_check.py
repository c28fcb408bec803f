"""Whether a cell with social vehicles is one: they make naive driving collide, and the agents meet them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from benchmark.experiment.config import EMPTY_ROADS
from benchmark.report.verdicts import (
    LEAST_DIFFERENCE,
    RULE_BASED,
    VERDICTS,
    all_hold,
    difference_of,
    is_at_least,
    shown_p,
    tested_rows,
)
from benchmark.results.reading import Results, RunResult
from benchmark.statistics import Difference

NAIVE = ("keep_lane", "random")
"""Drivers of which one has to collide more often than without social vehicles."""
LEAST_SHARE = 0.8
"""Of the rule-based driver's agent-episodes that meet social vehicles."""
MET = "met_social"


@dataclass(frozen=True)
class TrafficCheck:
    """Of one cell with social vehicles."""

    task: str
    traffic: str
    differences: dict[str, Difference]
    """Naive driver -> its collision rate minus that on empty roads, paired by episode."""
    share: float
    """Of the rule-based driver's agent-episodes with a social vehicle; NaN if that is not known."""

    @property
    def collides(self) -> bool | None:
        """Whether a naive driver collides more often; None if those that were played do not tell."""
        found = {is_at_least(each, LEAST_DIFFERENCE) for each in self.differences.values()}
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
        return all_hold((self.collides, self.meets))

    def __str__(self) -> str:
        differences = ", ".join(
            f"{name} {each.value:+z.2f} ({shown_p(each)})" for name, each in self.differences.items()
        )
        share = f"{self.share:.2f}" if math.isfinite(self.share) else "not measured"
        return (
            f"{self.task}, {self.traffic}: {VERDICTS[self.passes]}; collisions against empty roads: "
            f"{differences or 'not played'}; {RULE_BASED} meets social vehicles in: {share}"
        )


def traffic_checks(results: Results) -> list[TrafficCheck]:
    """Return the check of each cell with social vehicles that has a scripted policy, played yet or not."""
    tables = {(run.algorithm, run.task, run.traffic): run for run in results.finished if run.is_scripted}
    cells = dict.fromkeys(
        (run.task, run.traffic) for run in results.runs if run.is_scripted and run.traffic != EMPTY_ROADS
    )
    found = []
    for task, traffic in cells:
        differences = {}
        for name in NAIVE:
            empty, social = tables.get((name, task, EMPTY_ROADS)), tables.get((name, task, traffic))
            if empty and social and (difference := difference_of(social, empty, "collisions")):
                differences[name] = difference
        rule_based = tables.get((RULE_BASED, task, traffic))
        found.append(TrafficCheck(task, traffic, differences, _share(rule_based)))
    return found


def _share(run: RunResult | None) -> float:
    rows = tested_rows(run) if run is not None else None
    return float(rows[MET].mean()) if rows is not None and MET in rows else math.nan
