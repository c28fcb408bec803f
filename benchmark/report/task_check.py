"""Whether tasks tell good driving from bad: what scripted policies reach in each cell.

A good cell can be won by rules, is lost by random driving and by a driver that is blind to others, is another
one than on empty roads, and pays less for creeping than for driving: among social vehicles creeping also
completes less.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchmark.experiment.config import EMPTY_ROADS
from benchmark.metrics.results import Frame
from benchmark.metrics.table import EPISODE_KEYS
from benchmark.results.reading import Results, RunResult
from benchmark.statistics import Difference, paired_difference

RULE_BASED, CREEPING = "gap_acceptance", "creep"
BLIND = ("random", "empty_road")
"""Policies that have to do worse than the rule-based one among social vehicles."""
LEAST_COMPLETION = 0.9
"""Of the rule-based policy."""
LEAST_DIFFERENCE, MOST_P = 0.10, 0.01
MOST_EQUAL = 0.5
"""Largest share of the rule-based policy's agent-episodes that end as on empty roads, at the same time."""
SAME_TIME = 0.05
"""[s]"""
RETURN = "return"
ENDS = ("off_road", "off_route", "missed_goal", "not_moving", "time_out")


@dataclass(frozen=True)
class TaskCheck:
    """Of one cell; what was not played is None."""

    task: str
    traffic: str
    completion: float | None
    """Of the rule-based policy."""
    behind: dict[str, Difference]
    """Blind policy -> the rule-based policy's completion minus its, paired by episode."""
    creeping: dict[str, Difference]
    """"return" and "completion" -> the rule-based policy's minus that of creeping, paired by episode."""
    equal: dict[str, float]
    """Policy -> share of its agent-episodes that end as on empty roads, at the same time."""

    @property
    def failures(self) -> list[str]:
        """What the cell lacks."""
        found = []
        if self.completion is not None and self.completion < LEAST_COMPLETION:
            found.append(f"{RULE_BASED} completes {self.completion:.3f}, less than {LEAST_COMPLETION}")
        if self.traffic != EMPTY_ROADS:
            found += [
                f"{name} completes only {each.value:.2f} less than {RULE_BASED}"
                for name, each in self.behind.items()
                if not (each.value >= LEAST_DIFFERENCE and each.p_value < MOST_P)
            ]
        found += [
            f"{CREEPING} has a {name} only {each.value:.2f} below {RULE_BASED}'s"
            for name, each in self.creeping.items()
            if (name == RETURN or self.traffic != EMPTY_ROADS)
            and not (each.value > 0 and each.p_value < MOST_P)
        ]
        if self.equal.get(RULE_BASED, 0.0) > MOST_EQUAL:
            found.append(
                f"{RULE_BASED} ends as on empty roads in {self.equal[RULE_BASED]:.2f} of agent-episodes"
            )
        return found

    def __str__(self) -> str:
        verdict = f"FAILS: {'; '.join(self.failures)}" if self.failures else "passes"
        behind = [f"{name} completes {each.value:.2f} less" for name, each in self.behind.items()]
        behind += [f"{CREEPING} has {each.value:.2f} less {name}" for name, each in self.creeping.items()]
        behind += [f"{name} ends as on empty roads in {share:.2f}" for name, share in self.equal.items()]
        return f"{self.task}, {self.traffic}: {verdict} ({'; '.join(behind)})"


def task_checks(results: Results) -> list[TaskCheck]:
    """Return the check of each cell in which the rule-based policy was played."""
    runs = _runs(results)
    found = []
    for (policy, task, traffic), run in runs.items():
        if policy != RULE_BASED:
            continue
        blind = {name: runs[key] for name in BLIND if (key := (name, task, traffic)) in runs}
        creeping = runs.get((CREEPING, task, traffic))
        found.append(
            TaskCheck(
                task,
                traffic,
                float(_rows(run)["goals"].mean()),
                {name: _difference(run, other, "goals") for name, other in blind.items()},
                {
                    name: _difference(run, creeping, column)
                    for name, column in ((RETURN, RETURN), ("completion", "goals"))
                    if creeping is not None
                },
                {
                    name: _equal(social, empty)
                    for name in (RULE_BASED, "random")
                    if traffic != EMPTY_ROADS
                    and (social := runs.get((name, task, traffic)))
                    and (empty := runs.get((name, task, EMPTY_ROADS)))
                },
            )
        )
    return found


def score_table(results: Results) -> str:
    """Return outcomes, durations and returns of all scripted policies as a Markdown table."""
    lines = [
        "| task | traffic | policy | collision | completion | other ends | duration [s] | return |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (policy, task, traffic), run in sorted(_runs(results).items(), key=lambda item: item[0][1:]):
        rows = _rows(run)
        shares = {name: rows[f"ended_{name}"].mean() for name in ENDS}
        others = ", ".join(f"{name} {share:.2f}" for name, share in shares.items() if share >= 0.005)
        lines.append(
            f"| {task} | {traffic} | {policy} | {rows['collisions'].mean():.2f} | {rows['goals'].mean():.2f}"
            f" | {others} | {rows['seconds'].mean():.1f} | {rows['return'].mean():+.2f} |"
        )
    return "\n".join(lines)


def _runs(results: Results) -> dict[tuple[str, str, str], RunResult]:
    return {(run.algorithm, run.task, run.traffic): run for run in results.finished if run.is_scripted}


def _rows(run: RunResult) -> Frame:
    table: Frame = run.table
    return table[(table["split"] == "train") & ~table["is_invalid"] & (table["agents"] > 0)]


def _difference(one: RunResult, other: RunResult, column: str) -> Difference:
    """Return the mean difference of a column over the episodes that both played."""
    first, second = (_rows(run).groupby([*EPISODE_KEYS])[column].mean() for run in (one, other))
    gaps = (first - second).dropna().to_numpy(float)
    return paired_difference(gaps, is_share_of_counts=column == "goals")


def _equal(social: RunResult, empty: RunResult) -> float:
    keys = [*(name for name in EPISODE_KEYS if name != "traffic"), "agent"]
    one, other = (_rows(run).set_index(keys)[["outcome", "seconds"]] for run in (social, empty))
    one, other = one.align(other, join="inner", axis=0)
    is_equal = (one["outcome"] == other["outcome"]) & ((one["seconds"] - other["seconds"]).abs() < SAME_TIME)
    return float(is_equal.mean())
