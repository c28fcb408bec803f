"""The content of a report: main table, metrics, generalization, runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED, with_defaults
from benchmark.metrics import METRICS
from benchmark.metrics.results import Frame
from benchmark.report.against_paper import (
    ONE_SIDED,
    PASSES,
    BothLevels,
    Comparison,
    compare_with,
    degenerate_passes,
)
from benchmark.report.paper import Printed, algorithm_label, misprint, paper, printed
from benchmark.report.protocol import engine_marks, protocol_of, unlike_runs
from benchmark.report.ranking import (
    CONDITION,
    RANKED_BY,
    UNRANKED,
    Standing,
    differences,
    of_condition,
    ranks,
    with_seed_differences,
)
from benchmark.report.values import GENERALIZATION, MODES, Key, Value, by_key, measure_conditions
from benchmark.results.reading import Results, RunResult
from benchmark.results.versions import check_one_version

MOST_STEPS_APART = 0.05
"""Share by which the agent-steps of ranked trainings may differ from those usual in the condition."""
PROTOCOL = "protocol"
"""Column of agent-episodes that are compared."""


@dataclass(frozen=True)
class TableCell:
    """A cell of the main table."""

    task: str
    traffic: str
    collision: Value | None
    """None, as is completion, where no run is finished."""
    completion: Value | None
    printed: tuple[Printed, ...]
    """Figures that the paper prints."""
    comparison: Comparison | None
    """Comparison with the paper; None where one of the two has no figure or interval."""
    reasons: tuple[str, ...]
    """Why the comparison with the paper does not count."""
    standing: Standing
    """Among the learning algorithms of the column with the same protocol."""
    unlike: str = ""
    """Why its runs must not be averaged or compared, or on which engine they were tested if not on SUMO."""
    steps: int | None = None
    """Mean agent-steps of its trainings, if they are others than the column's, so that it has no rank."""

    @property
    def counts(self) -> bool:
        """Whether the comparison with the paper says anything."""
        return not self.reasons

    @property
    def is_best(self) -> bool:
        """Whether it is ranked, and no other algorithm's checkpoints are better."""
        return self.standing.rank == 1


@dataclass(frozen=True)
class Row:
    """A row of the main table."""

    algorithm: str
    is_scripted: bool
    cells: tuple[TableCell, ...]


@dataclass(frozen=True)
class Report:
    """Everything that is computed of an experiment's results."""

    results: Results
    values: Frame
    """Result of `measure_conditions`."""
    rates_at_90: Frame
    """The two rates with 90% intervals, whose ends are one-sided 95% ends."""
    differences: dict[str, Frame]
    """Result of `benchmark.report.ranking.with_seed_differences`, within each protocol, by mode."""
    unlike: dict[tuple[str, str, str], str]
    """Result of `benchmark.report.protocol.unlike_runs`."""

    @cached_property
    def _by_key(self) -> dict[Key, Value]:
        return by_key(self.values)

    @cached_property
    def _rates_at_90_by_key(self) -> dict[Key, Value]:
        return by_key(self.rates_at_90)

    @cached_property
    def modes(self) -> list[str]:
        """Ways of acting that were tested, the main one first; one even if nothing was.

        That of scripted policies is one only where no algorithm learns.
        """
        there = set(self.values["mode"])
        return [mode for mode in MODES if mode in there] or [MODES[0] if self.algorithms else SCRIPTED]

    @cached_property
    def algorithms(self) -> list[str]:
        """Learning algorithms, those of the paper first and in its order."""
        runs = self.results.runs
        return _ordered((run.algorithm for run in runs if not run.is_scripted), paper()["algorithms"])

    @cached_property
    def tasks(self) -> list[str]:
        """Tasks in the paper's order, others behind."""
        known = [*paper()["tasks"], *paper()["counterparts"]]
        return _ordered((run.task for run in self.results.runs), known)

    @cached_property
    def traffics(self) -> list[str]:
        """Kinds of traffic in the paper's order, others behind."""
        return _ordered((run.traffic for run in self.results.runs), paper()["traffic"])

    @cached_property
    def columns(self) -> list[tuple[str, str]]:
        """Pairs of task and traffic of which there is a run, in the order of the paper's table."""
        there = {(run.task, run.traffic) for run in self.results.runs}
        every = [(task, traffic) for traffic in self.traffics for task in self.tasks]
        return [column for column in every if column in there]

    @cached_property
    def names(self) -> list[tuple[str, bool]]:
        """Rows of tables: name, and whether it is a scripted policy."""
        return [*((name, False) for name in self.algorithms), *((name, True) for name in self.scripted)]

    @cached_property
    def scripted(self) -> list[str]:
        """Scripted policies."""
        return sorted({run.algorithm for run in self.results.runs if run.is_scripted})

    @cached_property
    def has_paper(self) -> bool:
        """Whether the paper prints figures of any of its conditions."""
        return any(self.printed(name, *column) for name in self.algorithms for column in self.columns)

    @cached_property
    def protocols(self) -> dict[tuple[str, str, str], str]:
        """Algorithm, task and traffic of finished trainings -> protocol."""
        runs = [run for run in self.results.finished if not run.is_scripted]
        return {(run.algorithm, run.task, run.traffic): protocol_of(run, self.results) for run in runs}

    @cached_property
    def compared(self) -> dict[tuple[str, str, str], str]:
        """Entries of `protocols` whose runs may be averaged and compared."""
        return {place: protocol for place, protocol in self.protocols.items() if place not in self.unlike}

    @cached_property
    def other_steps(self) -> dict[tuple[str, str, str], int]:
        """Mean agent-steps of trainings that took others than are usual in their condition and protocol."""
        rows = [
            (self.protocols[place], *place, float(run.progress["agent_steps"].iloc[-1]), _budget(run))
            for run in self.results.finished
            if run.progress is not None and len(run.progress)
            for place in [(run.algorithm, run.task, run.traffic)]
        ]
        table = pd.DataFrame(rows, columns=["protocol", "algorithm", "task", "traffic", "steps", "budget"])
        found: dict[tuple[str, str, str], int] = {}
        for _, cell in table.groupby(["protocol", "task", "traffic"]):
            means: Any = cell.groupby(["algorithm", "task", "traffic"])["steps"].mean()
            usual = usual_steps([*means], cell["budget"].iloc[0])
            others = means[[len(means) > 1 and not _are_alike(steps, usual) for steps in means]]
            found |= {place: round(steps) for place, steps in others.items()}
        return found

    @cached_property
    def marks(self) -> dict[tuple[str, str, str], str]:
        """Entries of `unlike`, and marks of tests on another engine than SUMO."""
        return engine_marks(self.results.finished) | self.unlike

    @cached_property
    def _unlike_paper(self) -> set[tuple[str, str]]:
        """Pairs of task and traffic with own scenarios, agents of the zoo, or learning agents in bubbles."""
        return {(run.task, run.traffic) for run in self.results.runs if _is_unlike_paper(run)}

    def printed(self, algorithm: str, task: str, traffic: str) -> tuple[Printed, ...]:
        """Return what the paper prints for a condition, nothing where the task is not that of the paper."""
        if (task, traffic) in self._unlike_paper:
            return ()
        return printed(algorithm, task, traffic)

    @cached_property
    def metrics(self) -> list[str]:
        """Metrics of which there is a row, in the order of `METRICS`."""
        there = set(self.values["metric"])
        return [name for name in METRICS if name in there]

    def value(self, algorithm: str, task: str, traffic: str, mode: str, metric: str) -> Value | None:
        """Return a value, of a scripted policy for any mode; None where there is none."""
        found = self._by_key.get((algorithm, task, traffic, mode, metric))
        return found or self._by_key.get((algorithm, task, traffic, SCRIPTED, metric))

    def main_table(self, mode: str) -> list[Row]:
        """Return the paper's table, scripted policies below."""
        standings = {column: self._ranks(*column, mode) for column in self.columns}
        rows = []
        for name, is_scripted in self.names:
            cells = [self._cell(name, *column, mode, standings[column]) for column in standings]
            rows.append(Row(name, is_scripted, tuple(cells)))
        return rows

    def _ranks(self, task: str, traffic: str, mode: str) -> dict[Any, Standing]:
        """Return the ranks within each protocol."""
        entries: dict[str, list[str]] = {}
        for name in self.algorithms:
            place = name, task, traffic
            is_tested = self.value(*place, mode, "completion_rate") is not None
            if is_tested and place in self.compared and place not in self.other_steps:
                entries.setdefault(self.compared[place], []).append(name)
        differing = of_condition(self.differences[mode], task, traffic)
        found: dict[Any, Standing] = {}
        for names in entries.values():
            found |= ranks(differing, names) if len(names) > 1 else {}
        return found

    def _cell(
        self, name: str, task: str, traffic: str, mode: str, standings: dict[Any, Standing]
    ) -> TableCell:
        collision = self.value(name, task, traffic, mode, "collision_rate")
        completion = self.value(name, task, traffic, mode, "completion_rate")
        theirs = self.printed(name, task, traffic)
        ours = self._figures(name, task, traffic, mode)
        comparison = compare_with(theirs, *ours) if ours else None
        return TableCell(
            task,
            traffic,
            collision,
            completion,
            theirs,
            comparison,
            tuple(self._reasons((name, task, traffic), mode, theirs, comparison)),
            standings.get(name, UNRANKED),
            self.marks.get((name, task, traffic), ""),
            self.other_steps.get((name, task, traffic)),
        )

    def _reasons(
        self, place: tuple[str, str, str], mode: str, theirs: Sequence[Printed], comparison: Comparison | None
    ) -> Iterator[str]:
        """Yield why a comparison with the paper does not count."""
        _, task, traffic = place

        def figures(driver: str) -> BothLevels | None:
            return (
                None if (driver, task, traffic) in self.unlike else self._figures(driver, task, traffic, mode)
            )

        degenerate = degenerate_passes(theirs, figures)
        passed, not_known = (
            ", ".join(algorithm_label(driver) for driver, passes in degenerate.items() if passes is which)
            for which in (True, None)
        )
        if passed:
            yield f"{passed} passes"
        if not_known and comparison and comparison.word in PASSES:
            yield f"not known whether {not_known} passes"
        if theirs and (why := misprint(*place)):
            yield why
        if place in self.marks:
            yield self.marks[place]

    def _figures(self, name: str, task: str, traffic: str, mode: str) -> BothLevels | None:
        """Return collision and completion rate with intervals of both levels, None without a finished run."""
        ours = []
        for values in (self._by_key, self._rates_at_90_by_key):
            for metric in reversed(RANKED_BY):
                found = values.get((name, task, traffic, mode, metric))
                ours.append(found or values.get((name, task, traffic, SCRIPTED, metric)))
        if any(value is None for value in ours):
            return None
        return (ours[0], ours[1]), (ours[2], ours[3])

    def generalization(self) -> Iterator[tuple[str, str, str, Value]]:
        """Yield algorithm, task, traffic and generalization where held-out variations were played."""
        for name, _ in self.names:
            for task, traffic in self.columns:
                found = self.value(name, task, traffic, self.modes[0], GENERALIZATION)
                if found and found.terms["held_out_completion"] == found.terms["held_out_completion"]:
                    yield name, task, traffic, found


def _is_unlike_paper(run: RunResult) -> bool:
    environment = run.config.get("environment") or {}
    has_others = any(environment.get(name) for name in ("social_agents", "learn_in_bubbles"))
    return has_others or with_defaults({"scenarios": [run.task], **run.config})["scenarios"] != [run.task]


def _budget(run: RunResult) -> float:
    """Return the agent-steps of a run's budget, NaN if it is not known or in minutes alone."""
    return float((run.config.get("budget") or {}).get("agent_steps") or math.nan)


def _are_alike(steps: float, others: float) -> bool:
    return abs(steps / others - 1) <= MOST_STEPS_APART


def usual_steps(means: Sequence[float], budget: float) -> float:
    """Return the agent-steps to which most of several algorithms are close; in doubt those of the budget.

    Where no two are close to each other, those of a budget in minutes are all far from its agent-steps.
    """
    return max(
        [budget, *means], key=lambda steps: max(1, sum(_are_alike(each, steps) for each in means))
    )  # each is close to itself, which says nothing


def _ordered(names: Iterable[str], known: Iterable[str]) -> list[str]:
    there = set(names)
    first = [name for name in known if name in there]
    return [*first, *sorted(there - set(first))]


def _with_reasons(values: Frame, marks: dict[tuple[str, str, str], str]) -> Frame:
    """Return values whose notes say why their runs must not be averaged or compared; see `Report.marks`."""
    places = zip(values["algorithm"], values["task"], values["traffic"], strict=True)
    reasons = [marks.get(place, "") for place in places]
    notes = ["; ".join(filter(None, each)) for each in zip(values["note"], reasons, strict=True)]
    return values.assign(note=notes)


def _to_compare(report: Report) -> Frame:
    """Return the agent-episodes that may be compared, with a column of their protocol.

    Those of scripted policies are there once for each protocol of their condition.
    """
    table = report.results.table
    places = zip(table["algorithm"], *(table[name] for name in CONDITION), strict=True)
    kept: Frame = table[[place not in report.unlike for place in places]]
    rows = [(*place, protocol) for place, protocol in report.compared.items()]
    protocols = pd.DataFrame(rows, columns=["algorithm", *CONDITION, PROTOCOL], dtype=object)
    is_scripted = kept["training_seed"] == SCRIPTED_SEED
    learnt = kept[~is_scripted].merge(protocols, on=["algorithm", *CONDITION])
    beside = protocols[[*CONDITION, PROTOCOL]].drop_duplicates()
    return pd.concat([learnt, kept[is_scripted].merge(beside, on=[*CONDITION])], ignore_index=True)


def make_report(results: Results) -> Report:
    """Return all that a report says of an experiment.

    Raises:
        ResultsError: Its runs are of several versions of the benchmark.
    """
    check_one_version(results.runs, str(results.root))
    table, unlike = results.table, unlike_runs(results.runs)
    values = _with_reasons(measure_conditions(table), engine_marks(results.finished) | unlike)
    report = Report(results, values, measure_conditions(table, RANKED_BY, ONE_SIDED), {}, unlike)
    compared = _to_compare(report) if len(table) else table
    for mode in report.modes:
        found = differences(compared, mode, within=(*CONDITION, PROTOCOL))
        report.differences[mode] = with_seed_differences(found, compared, mode)
    return report
