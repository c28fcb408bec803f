"""Figures that a report shows first: of the policy that drove best, and whether more training would help."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.metrics.results import Frame
from benchmark.report.content import Report
from benchmark.report.drawing import seeds_curve
from benchmark.report.paper import algorithm_label
from benchmark.report.ranking import RANKED_BY
from benchmark.report.summary import SCORES, Summaries
from benchmark.report.values import Value
from benchmark.results.commands import read_commands
from benchmark.results.reading import RunResult
from benchmark.statistics import stratified_interval
from smarts.types.streams import Purpose, stream

COMPLETION, COLLISION = RANKED_BY
RISE, GOOD = 0.05, 0.95
"""Least change of completion in a training's last third that counts; tested completion that suffices."""
LEAST_LINES = 10
"""Lines of progress.csv of each seed that are needed to tell; each is a mean over many episodes."""
LONGER = 5
"""How many times longer the next command trains."""

Place = tuple[str, str]
"""Task and traffic."""


@dataclass(frozen=True)
class Rate:
    """One of the two rates of the policy that the report is about, mean over its conditions."""

    value: float
    low: float
    """NaN, as is `high`, where there is no interval."""
    high: float
    beside: dict[str, float]
    """Scripted policies with theirs in the same conditions."""

    @property
    def interval(self) -> str:
        """The interval, empty without one."""
        return f"{self.low:.2f} to {self.high:.2f}" if math.isfinite(self.low) else ""


def spoken(report: Report, name: str) -> str:
    """Return the name of an algorithm, or of a scripted policy in words."""
    return name.replace("_", " ") if name in report.scripted else algorithm_label(name)


def places_of(report: Report, name: str) -> list[Place]:
    """Return the conditions of which a policy has both rates."""
    return [place for place in report.columns if all(known(report, name, place, rate) for rate in RANKED_BY)]


def best_first(report: Report) -> list[str]:
    """Return learning algorithms, then scripted policies: by finished conditions, then by completion."""
    places = {name: places_of(report, name) for name, _ in report.names}

    def order(name: str) -> tuple[bool, int, float]:
        mean = _mean(report, name, places[name], COMPLETION) if places[name] else 0.0
        return name in report.scripted, -len(places[name]), -mean

    return sorted(places, key=order)


def leader(report: Report) -> str:
    """Return the first finished policy of `best_first`; "" if none is finished."""
    return next((name for name in best_first(report) if places_of(report, name)), "")


def rivals(report: Report, name: str) -> int:
    """Return how many algorithms have finished a policy's conditions under its protocol, it included."""
    places = places_of(report, name)

    def protocols(each: str) -> list[str | None]:
        keys = [(each, *place) for place in places]
        return [None if key in report.other_steps else report.compared.get(key) for key in keys]

    return sum(
        protocols(each) == protocols(name) for each in report.algorithms if None not in protocols(each)
    )


def rates(report: Report, summaries: Summaries, name: str) -> dict[str, Rate]:
    """Return completion and collision rate of a finished policy, means over its conditions."""
    places = places_of(report, name)
    beside = [x for x in report.scripted if x != name and {*places} <= {*places_of(report, x)}]
    found = {}
    for metric, score in zip(RANKED_BY, SCORES, strict=True):
        scores = summaries.scores.get(score, {}).get(name)
        value = known(report, name, places[0], metric)
        ends = (value.low, value.high) if value and len(places) == 1 else (math.nan, math.nan)
        if len(places) > 1 and scores is not None and len(scores) > 1:
            shares = scores if metric == COMPLETION else 1.0 - scores
            low, high = stratified_interval(np.mean, stream(0, Purpose.RESAMPLING), shares)
            ends = float(low), float(high)
        others = {each: _mean(report, each, places, metric) for each in beside}
        found[metric.removesuffix("_rate")] = Rate(_mean(report, name, places, metric), *ends, others)
    return found


def trend(runs: Sequence[Frame]) -> float | None:
    """Return by how much completion changed over the last third of a training; None if that is not known.

    Args:
        runs: Progress of each seed.
    """
    steps, rows = seeds_curve(runs, "completion")
    if not len(steps) or min(map(len, runs)) < LEAST_LINES:
        return None
    mean = rows.mean(axis=0)
    last = np.isfinite(mean) & (steps >= steps[0] + (steps[-1] - steps[0]) * 2 / 3)
    return float(np.polyfit(steps[last], mean[last], 1)[0] * np.ptp(steps[last])) if last.any() else None


def trends(report: Report) -> dict[tuple[str, str, str], float]:
    """Return algorithm, task and traffic of finished trainings whose trend is known -> `trend`."""
    runs: dict[tuple[str, str, str], list[Frame]] = {}
    for run in report.results.finished:
        if run.progress is not None and not run.is_scripted:
            runs.setdefault((run.algorithm, run.task, run.traffic), []).append(run.progress)
    found = {place: trend(each) for place, each in runs.items()}
    return {place: rise for place, rise in found.items() if rise is not None}


def rising(report: Report) -> list[tuple[str, str, str]]:
    """Return the trainings that still improved, and whose policies complete less than `GOOD` in the test."""
    found = []
    for (name, task, traffic), rise in trends(report).items():
        tested = known(report, name, (task, traffic), COMPLETION)
        if rise > RISE and (tested is None or tested.value < GOOD):
            found.append((name, task, traffic))
    return found


def runs_of_policy(report: Report, name: str) -> list[RunResult]:
    """Return the finished runs of an algorithm or a scripted policy."""
    return [run for run in report.results.finished if run.algorithm == name]


def mean_of_last(report: Report, name: str, column: str) -> float | None:
    """Return the mean of the last lines of progress.csv of an algorithm's finished runs, None without any."""
    lines = [run.progress[column] for run in runs_of_policy(report, name) if run.progress is not None]
    return float(np.mean([line.iloc[-1] for line in lines if len(line)])) if any(map(len, lines)) else None


def run_commands(report: Report) -> list[str]:
    """Return the commands that trained, as the shell has them."""
    return [line for line in report.results.commands if line.startswith("smarts-bench run ")]


def larger_budget(report: Report) -> str:
    """Return a larger budget where trainings that still improve have one, of no version of the benchmark.

    "" where they have it from `by_task`, which `--set` does not override.
    """
    places = rising(report)
    runs = [run for run in report.results.finished if (run.algorithm, run.task, run.traffic) in places]
    budgets = {(run.config["budget"].get("minutes"), run.config["budget"]["agent_steps"]) for run in runs}
    if len(budgets) != 1 or any(run.benchmark_version or _has_own_budget(report, run) for run in runs):
        return ""
    ((minutes, steps),) = budgets
    took = [run.progress["agent_steps"].iloc[-1] for run in runs if run.progress is not None]
    if steps is None or (minutes and max(took) < steps):
        return f"budget.minutes={LONGER * minutes:g}"
    return f"budget.agent_steps={LONGER * steps}"


def _has_own_budget(report: Report, run: RunResult) -> bool:
    """Return whether `by_task` of any command's experiment gives a run's budget."""
    _, experiments = read_commands(report.results.root, {})
    names = run.task, f"{run.task}/{run.traffic}"
    given = [each.by_task.get(name) for each in experiments if each for name in names]
    return any(each.budget.model_fields_set for each in given if each)


def known(report: Report, name: str, place: Place, metric: str) -> Value | None:
    """Return a value of the main mode, None where there is none or it is n/a."""
    found = report.value(name, *place, report.modes[0], metric)
    return found if found and found.is_known else None


def _mean(report: Report, name: str, places: Sequence[Place], metric: str) -> float:
    return float(np.mean([value.value for x in places if (value := known(report, name, x, metric))]))
