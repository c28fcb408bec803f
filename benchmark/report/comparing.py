"""Two experiments or algorithms side by side: differences at equal starts."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED
from benchmark.metrics import METRICS, compare
from benchmark.metrics.differences import SIGNIFICANCE
from benchmark.metrics.results import Frame
from benchmark.report.protocol import described, differing_scenarios, differing_trainings, protocol_of
from benchmark.report.ranking import CONDITION
from benchmark.results.files import ResultsError
from benchmark.results.reading import RUNS, Results, RunResult, holds_results, read_results
from benchmark.results.versions import check_one_version

COLUMNS = (
    "first",
    "second",
    *CONDITION,
    "metric",
    "value",
    "low",
    "high",
    "pairs",
    "first_seeds",
    "second_seeds",
    "p_value",
    "corrected",
    "better",
    "note",
)
DIFFERS = "differs"
"""Word in place of the better side, for metrics that are neither better when higher nor when lower."""


@dataclass(frozen=True)
class Side:
    """What is compared."""

    path: Path
    results: Results
    runs: tuple[RunResult, ...]
    """Finished ones."""
    left_out: tuple[str, ...] = ()
    """Runs and files that are ignored, with the reason."""
    name: str = ""
    """Display name."""

    @property
    def algorithms(self) -> list[str]:
        """Names, in the order of their runs."""
        return [*dict.fromkeys(run.algorithm for run in self.runs)]


def read_side(path: Path) -> Side:
    """Return the finished runs of an experiment, or of one algorithm: results/NAME or results/NAME/ALGORITHM.

    Raises:
        ResultsError: No run is finished.
    """
    root, algorithm = _root_of(path)
    results = read_results(root)

    meant = [
        run for run in results.runs if (run.algorithm == algorithm if algorithm else not run.is_scripted)
    ]
    places = tuple(f"{run.place}/" for run in meant) if algorithm else ""
    left_out = [f"{run} is not finished: {run.status}" for run in meant if run.table is None]
    left_out += [
        f"{name}: {reason}" for name, reason in results.problems.items() if f"{name}/".startswith(places)
    ]
    runs = tuple(run for run in meant if run.table is not None)
    if not runs:
        raise ResultsError(
            "; ".join(["there is no finished run", *left_out]),
            place=str(path),
            remedy="give results/NAME[/ALGORITHM] of a finished one, or results/NAME/scripted/POLICY",
        )
    return Side(path, results, runs, tuple(left_out), results.name)


def _root_of(path: Path) -> tuple[Path, str]:
    """Return an experiment's folder, and the algorithm whose folder is given, "" for the experiment's."""
    whole = path.resolve()
    root = whole.parents[1] if whole.parent.name == SCRIPTED else whole.parent
    if not path.is_dir() and not (root / RUNS).exists():
        raise ResultsError("there is no such folder", place=str(path), remedy="give results/NAME[/ALGORITHM]")
    if holds_results(path):
        return path, ""
    return root, whole.name


def with_distinct_names(first: Side, second: Side) -> tuple[Side, Side]:
    """Return both sides with distinct names; experiments with equal names get their paths."""
    roots = [each.results.root.resolve() for each in (first, second)]
    if roots[0] == roots[1] or first.name != second.name:
        return first, second
    return replace(first, name=str(first.results.root)), replace(second, name=str(second.results.root))


def compare_sides(first: Side, second: Side, metrics: Sequence[str], mode: str) -> Frame:
    """Return the differences at equal starts between two sides, Holm-corrected over conditions and metrics.

    One algorithm a side is compared whatever their names; of several, those that both sides have.

    Args:
        first: The minuend.
        second: The subtrahend.
        metrics: Names.
        mode: Way of acting.

    Returns:
        A row for each pair of algorithms, condition and metric, with `COLUMNS`; `better` is "" for a tie, and
        where `p_value` is NaN, since they could not be compared; it is `DIFFERS` where a metric that only
        describes differs. Seeds are how many of training a side has there; scripted policies have none.

    Raises:
        ResultsError: There is nothing in common, or they are of several versions of the benchmark.
        UnknownNameError: A metric is unknown.
    """
    check_one_version([*first.runs, *second.runs], f"{first.path}, {second.path}")
    # Each once, since p-values are corrected for their number.
    metrics = [*dict.fromkeys(metrics)]
    for name in metrics:
        METRICS[name]
    pairs = _pairs(first, second)
    table = _played(first, second, pairs)
    table = table[(table["split"] != "held_out") & table["mode"].isin([mode, SCRIPTED])]
    found = compare(table, metrics, ["pair", *CONDITION], "side", family=())
    if not len(found):
        raise ResultsError(
            f"nothing that both have: no common task, traffic and {mode} episodes",
            place=f"{first.path}, {second.path}",
            remedy="compare experiments on the same tasks and traffic",
        )
    sides = {"A": (first, 0), "B": (second, 1)}
    names = {
        letter: [f"{side.name}: {pairs[pair][number]}" for pair in found["pair"]]
        for letter, (side, number) in sides.items()
    }
    seeds = _training_seeds(table)
    cells = [*zip(found["pair"], *(found[name] for name in CONDITION), strict=True)]
    counts = {letter: [seeds.get((*cell, letter), 0) for cell in cells] for letter in sides}
    differs = [
        METRICS[name].better is None and corrected < SIGNIFICANCE
        for name, corrected in zip(found["metric"], found["corrected"], strict=True)
    ]
    return found.assign(
        first=names["A"],
        second=names["B"],
        first_seeds=counts["A"],
        second_seeds=counts["B"],
        better=[
            names[wins][row] if wins else DIFFERS if differs[row] else ""
            for row, wins in enumerate(found["wins"])
        ],
    )[[*COLUMNS]]


def _played(first: Side, second: Side, pairs: Sequence[tuple[str, str]]) -> Frame:
    """Return the agent-episodes of all pairs, with columns `pair` (number) and `side` ("A" or "B")."""
    parts = [
        run.table.assign(pair=number, side=letter)
        for number, pair in enumerate(pairs)
        for letter, side, name in zip("AB", (first, second), pair, strict=True)
        for run in side.runs
        if run.algorithm == name and run.table is not None
    ]
    return pd.concat(parts, ignore_index=True)


def _training_seeds(table: Frame) -> dict[Hashable, int]:
    """Return how many seeds of training each side has, by pair, task, traffic and side."""
    learnt = table[table["training_seed"] != SCRIPTED_SEED]
    return learnt.groupby(["pair", *CONDITION, "side"])["training_seed"].nunique().to_dict()


def differing_protocols(first: Side, second: Side) -> list[str]:
    """Return a line for each protocol with its differing values; none if there is one protocol."""
    found = dict.fromkeys(protocol_of(run, side.results) for side in (first, second) for run in side.runs)
    return described([*found]) if len(found) > 1 else []


def runs_apart(first: Side, second: Side) -> list[str]:
    """Return a sentence for each scenario, and for each seed's training, that runs did not have alike."""
    sides = (first, second)
    scenarios = differing_scenarios((run, f"{side.name}: {run}") for side in sides for run in side.runs)
    trainings = [line for side in sides for line in differing_trainings(side.runs, f"{side.name}: ")]
    return scenarios + trainings


def only_one_has(first: Side, second: Side) -> list[str]:
    """Return a sentence for each algorithm and condition of which only one side has a finished run."""
    pairs = _pairs(first, second)
    return [*_only_first(first, second, dict(pairs)), *_only_first(second, first, {y: x for x, y in pairs})]


def _only_first(side: Side, other: Side, counterparts: Mapping[str, str]) -> Iterator[str]:
    there = {(run.algorithm, run.task, run.traffic) for run in other.runs}
    for algorithm, *cell in dict.fromkeys((run.algorithm, run.task, run.traffic) for run in side.runs):
        if (counterparts.get(algorithm), *cell) not in there:
            yield f"{side.name}: {', '.join((algorithm, *cell))}: the other side has no such finished run"


def _pairs(first: Side, second: Side) -> list[tuple[str, str]]:
    one, other = first.algorithms, second.algorithms
    if len(one) == 1 and len(other) == 1:
        return [(one[0], other[0])]
    common = [(name, name) for name in one if name in other]
    if not common:
        raise ResultsError(
            f"no algorithm that both have: {', '.join(one)} and {', '.join(other)}",
            place=f"{first.path}, {second.path}",
            remedy="name one of each: results/NAME/ALGORITHM",
        )
    return common
