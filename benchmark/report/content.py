"""The content of a report: main table, metrics, generalization, runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from benchmark.experiment.runs import SCRIPTED
from benchmark.metrics import METRICS
from benchmark.metrics.results import Frame
from benchmark.report.against_paper import ONE_SIDED, BothLevels, Comparison, compare_with, passing
from benchmark.report.paper import Printed, misprint, paper, printed
from benchmark.report.ranking import RANKED_BY, Standing, differences, of_cell, ranks
from benchmark.report.seed_differences import with_seed_differences
from benchmark.report.traffic_check import TrafficCheck, traffic_checks
from benchmark.report.values import (
    GENERALIZATION,
    MODES,
    Key,
    Value,
    by_key,
    measure_cells,
)
from benchmark.results.reading import Results
from benchmark.results.versions import check_one_version


@dataclass(frozen=True)
class TableCell:
    """A cell of the main table."""

    task: str
    traffic: str
    collision: Value | None
    """None, as is completion, where no run is finished."""
    completion: Value | None
    printed: tuple[Printed, ...]
    """The paper's."""
    comparison: Comparison | None
    """With the paper; None where one of the two has no figure or interval."""
    passed_by: tuple[str, ...]
    """Degenerate drivers that pass the paper's cell, which therefore does not count."""
    misprint: str
    """Why the paper's figures look like a misprint and do not count, "" if they do not."""
    rank: int | None
    """Among the learning algorithms of the column; None without another one to compare with."""
    is_tied: bool
    """Whether one that it was compared with has the same rank."""
    is_without_traffic: bool = False
    """Whether it is a cell with social vehicles in name only, which therefore does not count."""

    @property
    def counts(self) -> bool:
        """Whether the comparison with the paper says anything."""
        return not (self.passed_by or self.misprint or self.is_without_traffic)

    @property
    def is_best(self) -> bool:
        """Whether no other one of the column is better."""
        return self.rank == 1


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
    """Of `measure_cells`."""
    one_sided: Frame
    """The two rates with intervals whose ends are one-sided 95% ends."""
    differences: dict[str, Frame]
    """By mode; of `benchmark.report.seed_differences.with_seed_differences`."""

    @cached_property
    def _by_key(self) -> dict[Key, Value]:
        return by_key(self.values)

    @cached_property
    def _one_sided_by_key(self) -> dict[Key, Value]:
        return by_key(self.one_sided)

    @cached_property
    def traffic_checks(self) -> list[TrafficCheck]:
        """Of cells with social vehicles in which scripted policies were played."""
        return traffic_checks(self.results)

    @cached_property
    def modes(self) -> list[str]:
        """Ways of acting that were tested, the main one first; one even if nothing was."""
        there = set(self.values["mode"])
        return [mode for mode in MODES if mode in there] or [MODES[0]]

    @cached_property
    def algorithms(self) -> list[str]:
        """Learning algorithms, those of the paper first and in its order."""
        runs = self.results.runs
        return _ordered((run.algorithm for run in runs if not run.is_scripted), paper()["algorithms"])

    @cached_property
    def tasks(self) -> list[str]:
        """In the paper's order, others behind."""
        known = [*paper()["tasks"], *paper()["counterparts"]]
        return _ordered((run.task for run in self.results.runs), known)

    @cached_property
    def traffics(self) -> list[str]:
        """In the paper's order, others behind."""
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
        """Whether the paper prints figures of any of its cells."""
        return any(self.printed(name, *column) for name in self.algorithms for column in self.columns)

    @cached_property
    def _unlike_paper(self) -> set[tuple[str, str]]:
        """Pairs of task and traffic with agents of the zoo, or with learning agents in bubbles."""
        return {
            (run.task, run.traffic)
            for run in self.results.runs
            for name in ("social_agents", "learn_in_bubbles")
            if (run.config.get("environment") or {}).get(name)
        }

    def printed(self, algorithm: str, task: str, traffic: str) -> tuple[Printed, ...]:
        """Return what the paper prints for a cell, nothing where other agents drive than in the paper."""
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
        entries = [
            name
            for name in self.algorithms
            if self.value(name, task, traffic, mode, "completion_rate") is not None
        ]
        return ranks(of_cell(self.differences[mode], task, traffic), entries) if len(entries) > 1 else {}

    def _cell(
        self, name: str, task: str, traffic: str, mode: str, standings: dict[Any, Standing]
    ) -> TableCell:
        collision = self.value(name, task, traffic, mode, "collision_rate")
        completion = self.value(name, task, traffic, mode, "completion_rate")
        theirs = self.printed(name, task, traffic)
        ours = self._figures(name, task, traffic, mode)
        standing = standings.get(name)
        return TableCell(
            task,
            traffic,
            collision,
            completion,
            theirs,
            compare_with(theirs, *ours) if ours else None,
            passing(theirs, self.scripted, lambda driver: self._figures(driver, task, traffic, mode)),
            misprint(name, task, traffic) if theirs else "",
            standing.rank if standing else None,
            standing is not None and standing.is_tied,
            any((x.task, x.traffic, x.is_one) == (task, traffic, False) for x in self.traffic_checks),
        )

    def _figures(self, name: str, task: str, traffic: str, mode: str) -> BothLevels | None:
        """Return collision and completion rate with intervals of both levels, None without a finished run."""
        ours = []
        for values in (self._by_key, self._one_sided_by_key):
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


def _ordered(names: Iterable[str], known: Iterable[str]) -> list[str]:
    there = set(names)
    first = [name for name in known if name in there]
    return [*first, *sorted(there - set(first))]


def make_report(results: Results) -> Report:
    """Return all that a report says of an experiment.

    Raises:
        ResultsError: Its runs are of several versions of the benchmark.
    """
    check_one_version(results.runs, str(results.root))
    values = measure_cells(results.table)
    table = results.table
    report = Report(results, values, measure_cells(table, RANKED_BY, ONE_SIDED), {})
    for mode in report.modes:
        report.differences[mode] = with_seed_differences(differences(table, mode), table, mode)
    return report
