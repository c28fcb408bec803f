"""Whether tasks tell good driving from bad: what scripted policies reach in each cell.

A good cell can be won by rules, is lost by random driving and by a driver that is blind to others, is another
one than on empty roads, and pays less for creeping than for driving: among social vehicles creeping also
completes less.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from benchmark.experiment.config import EMPTY_ROADS
from benchmark.metrics.results import Frame
from benchmark.metrics.table import EPISODE_KEYS
from benchmark.report.verdicts import (
    LEAST_DIFFERENCE,
    RULE_BASED,
    VERDICTS,
    all_hold,
    difference_of,
    is_at_least,
    is_positive,
    shown_p,
    tested_rows,
)
from benchmark.results.reading import Results, RunResult
from benchmark.statistics import Difference

CREEPING = "creep"
BLIND = ("random", "empty_road")
"""Policies that have to do worse than the rule-based one among social vehicles."""
LEAST_COMPLETION = 0.9
"""Of the rule-based policy."""
MOST_EQUAL = 0.5
"""Largest share of the rule-based policy's agent-episodes that end as on empty roads, at the same time."""
SAME_TIME = 0.05
"""[s]"""
RETURN, COMPLETION = "return", "completion"
ASKING = ("empty_road", CREEPING)
"""Policies that are played for this check alone: an experiment that names one of them asks for it."""
ENDS = ("off_road", "off_route", "missed_goal", "not_moving", "time_out")


Runs = Mapping[tuple[str, str, str], RunResult]
"""(Scripted policy, task, traffic) -> its test."""


@dataclass(frozen=True)
class TaskCheck:
    """Of one cell; what was not played is NaN or missing."""

    task: str
    traffic: str
    completion: float
    """Of the rule-based policy."""
    behind: dict[str, Difference]
    """Blind policy -> the rule-based policy's completion minus its, paired by episode."""
    creeping: dict[str, Difference]
    """"return" and "completion" -> the rule-based policy's minus that of creeping, paired by episode."""
    equal: dict[str, float]
    """Policy -> share of its agent-episodes that end as on empty roads, at the same time."""

    @property
    def conditions(self) -> dict[str, bool | None]:
        """What was found -> whether it is as a cell needs it; None if that is not known."""
        is_social = self.traffic != EMPTY_ROADS
        found: dict[str, bool | None] = {f"{RULE_BASED} was not played": None}
        if math.isfinite(self.completion):
            completed = f"{RULE_BASED} completes {self.completion:.3f}, of at least {LEAST_COMPLETION}"
            found = {completed: self.completion >= LEAST_COMPLETION}
        for name in BLIND if is_social else ():
            each = self.behind.get(name)
            found[_less(name, each, COMPLETION)] = each and is_at_least(each, LEAST_DIFFERENCE)
        for name in (RETURN, COMPLETION) if is_social else (RETURN,):
            each = self.creeping.get(name)
            found[_less(CREEPING, each, name)] = each and is_positive(each)
        if is_social:
            share = self.equal.get(RULE_BASED, math.nan)
            ends = f"{RULE_BASED} ends as on empty roads in {share:.2f} of agent-episodes"
            is_known = math.isfinite(share)
            if not is_known:
                ends = (
                    f"{RULE_BASED} was not played both here and on empty roads, or its times are not measured"
                )
            found[ends] = share <= MOST_EQUAL if is_known else None
        return found

    @property
    def passes(self) -> bool | None:
        """Whether all conditions hold; None if none is known to fail and some are not known."""
        return all_hold(self.conditions.values())

    @property
    def failures(self) -> list[str]:
        """What the cell lacks."""
        return [text for text, holds in self.conditions.items() if holds is False]

    @property
    def unknown(self) -> list[str]:
        """Conditions that are not known to hold or to fail."""
        return [text for text, holds in self.conditions.items() if holds is None]

    def __str__(self) -> str:
        groups = {False: self.failures, None: self.unknown}
        said = [f"{VERDICTS[holds]}: {'; '.join(texts)}" for holds, texts in groups.items() if texts]
        known = [text for text, holds in self.conditions.items() if holds]
        if "random" in self.equal:
            known.append(f"random ends as on empty roads in {self.equal['random']:.2f}")
        return f"{self.task}, {self.traffic}: {'; '.join(said) or VERDICTS[True]} ({'; '.join(known)})"


def task_checks(results: Results) -> list[TaskCheck]:
    """Return the check of each cell with a scripted policy, played yet or not.

    There is none without `empty_road` or `creep` among the experiment's scripted policies, which are played
    for this check alone.
    """
    scripted = [run for run in results.runs if run.is_scripted]
    if not any(run.algorithm in ASKING for run in scripted):
        return []
    runs = _runs(results)
    return [_check(runs, *cell) for cell in dict.fromkeys((run.task, run.traffic) for run in scripted)]


def _check(runs: Runs, task: str, traffic: str) -> TaskCheck:
    def played(name: str, traffic: str = traffic) -> RunResult | None:
        return runs.get((name, task, traffic))

    rule_based, creeping = played(RULE_BASED), played(CREEPING)
    behind, worse, equal = {}, {}, {}
    for name in BLIND:
        blind = played(name)
        if rule_based and blind and (found := difference_of(rule_based, blind, "goals")):
            behind[name] = found
    for name, column in ((RETURN, "return"), (COMPLETION, "goals")):
        if rule_based and creeping and (found := difference_of(rule_based, creeping, column)):
            worse[name] = found
    for name in (RULE_BASED, "random"):
        social, empty = played(name), played(name, EMPTY_ROADS)
        if traffic != EMPTY_ROADS and social and empty and (share := _equal(social, empty)) is not None:
            equal[name] = share
    completion = float(tested_rows(rule_based)["goals"].mean()) if rule_based else math.nan
    return TaskCheck(task, traffic, completion, behind, worse, equal)


def score_table(results: Results) -> str:
    """Return outcomes, durations and returns of all scripted policies as a Markdown table."""
    lines = [
        "| task | traffic | policy | collision | completion | other ends | duration [s] | return |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (policy, task, traffic), run in sorted(_runs(results).items(), key=lambda item: item[0][1:]):
        rows = tested_rows(run)
        shares = {name: rows[f"ended_{name}"].mean() for name in ENDS if f"ended_{name}" in rows}
        others = ", ".join(f"{name} {share:.2f}" for name, share in shares.items() if share >= 0.005)
        lines.append(
            f"| {task} | {traffic} | {policy} | {rows['collisions'].mean():.2f} | {rows['goals'].mean():.2f}"
            f" | {others} | {_mean(rows, 'seconds', '.1f')} | {_mean(rows, 'return', '+.2f')} |"
        )
    return "\n".join(lines)


def _mean(rows: Frame, column: str, how: str) -> str:
    return format(rows[column].mean(), how) if column in rows else "n/a"


def _runs(results: Results) -> Runs:
    return {(run.algorithm, run.task, run.traffic): run for run in results.finished if run.is_scripted}


def _less(name: str, difference: Difference | None, column: str) -> str:
    if difference is None:
        return f"{name} was not played beside {RULE_BASED}, or its {column} is not measured"
    return f"{name} has {difference.value:z.2f} less {column} ({shown_p(difference)})"


def _equal(social: RunResult, empty: RunResult) -> float | None:
    """Return the share of agent-episodes that end alike at the same time; None if times are not measured."""
    tables = [tested_rows(run) for run in (social, empty)]
    if not all("seconds" in table for table in tables):
        return None
    keys = [*(name for name in EPISODE_KEYS if name != "traffic"), "agent"]
    one, other = (table.set_index(keys)[["outcome", "seconds"]] for table in tables)
    one, other = one.align(other, join="inner", axis=0)
    is_equal = (one["outcome"] == other["outcome"]) & ((one["seconds"] - other["seconds"]).abs() < SAME_TIME)
    return float(is_equal.mean())
