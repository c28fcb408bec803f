"""The content of a report: main table, metrics, generalization, runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from benchmark.experiment.runs import SCRIPTED
from benchmark.metrics import METRICS
from benchmark.metrics.results import Frame
from benchmark.report.paper import Printed, is_non_inferior, paper, printed
from benchmark.report.ranking import Standing, differences, of_cell, ranks
from benchmark.report.values import (
    GENERALIZATION,
    MODES,
    Key,
    Value,
    by_key,
    measure_cells,
)
from benchmark.results.reading import Results


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
    is_non_inferior: bool | None
    """To the paper; None where one of the two has no figure, or there are too few test episodes."""
    rank: int | None
    """Among the learning algorithms of the column; None without another one to compare with."""
    is_tied: bool
    """Whether one that it was compared with has the same rank."""

    @property
    def is_best(self) -> bool:
        """Whether no other one of the column is better."""
        return self.rank == 1

    @property
    def is_short(self) -> bool:
        """Whether there are fewer test episodes than a comparison with the paper asks for."""
        return self.completion is not None and _is_short(self.completion)


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
    differences: dict[str, Frame]
    """By mode; of `benchmark.report.ranking.differences`."""

    @cached_property
    def _by_key(self) -> dict[Key, Value]:
        return by_key(self.values)

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
        return _ordered((run.task for run in self.results.runs), paper()["tasks"])

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
        scripted = sorted({run.algorithm for run in self.results.runs if run.is_scripted})
        return [*((name, False) for name in self.algorithms), *((name, True) for name in scripted)]

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
        theirs = printed(name, task, traffic)
        standing = standings.get(name)
        return TableCell(
            task,
            traffic,
            collision,
            completion,
            theirs,
            _is_non_inferior(theirs, collision, completion),
            standing.rank if standing else None,
            standing is not None and standing.is_tied,
        )

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


def _is_short(found: Value) -> bool:
    return found.episodes < paper()["test_episodes"] * max(1, found.seeds)


def _is_non_inferior(
    theirs: tuple[Printed, ...], collision: Value | None, completion: Value | None
) -> bool | None:
    if collision is None or completion is None or not (collision.is_known and completion.is_known):
        return None
    if _is_short(completion):
        return None
    return is_non_inferior(theirs, collision.value, completion.value)


def make_report(results: Results) -> Report:
    """Return all that a report says of an experiment."""
    values = measure_cells(results.table)
    report = Report(results, values, {})
    table = results.table
    for mode in report.modes:
        report.differences[mode] = differences(table, mode)
    return report
