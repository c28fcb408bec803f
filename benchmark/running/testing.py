"""The test of a policy: recorded episodes, measured into one table."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from algorithms.joint.evaluation import REPORTED_WORLDS, evaluate
from benchmark.experiment.runs import Cell, ReferenceRun, Run
from benchmark.floors.run import episodes_in
from benchmark.metrics import join_tables, measure_episodes, write_table
from benchmark.metrics.table import COUNTS
from benchmark.running.environments import environment
from benchmark.running.folder import FINISHED, TESTING, RunFolder
from benchmark.running.held_out import held_out_of
from benchmark.running.machine import machine

EVALUATION_SEED = 42
"""Root seed of validation and test, the same for all runs: their episodes begin alike."""

SCRIPTED = "scripted"
"""Mode of policies that act in one way only."""


@dataclass(frozen=True)
class Part:
    """A part of a test."""

    mode: str
    """How the policy acts: "greedy" or "sampled"; "scripted" if it always acts in the same way."""
    scenarios: tuple[str, ...]
    episodes: int
    split: str = "train"
    """"train" or "held_out"."""

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.mode}-{'-'.join(Path(each).name for each in self.scenarios)}"


def parts_of(cell: Cell, modes: tuple[str, ...]) -> Iterator[Part]:
    """Yield the parts of a cell's test: each mode, then the held-out variations in the first one."""
    evaluation = cell.evaluation
    for mode in modes:
        yield Part(mode, cell.task.scenarios, evaluation.episodes)
    for scenario in held_out_of(cell):
        yield Part(modes[0], (scenario,), evaluation.held_out_episodes, split="held_out")


def test(run: Run, folder: RunFolder, algo: Any) -> Iterator[float]:
    """Play the test of a trained policy and write its table; yields the share that is done."""

    def play_part(part: Part, record: Path) -> None:
        discount = algo.config.gamma
        with closing(
            environment(run.cell, scenarios=part.scenarios, record=record, discount=discount)
        ) as env:
            evaluate(
                algo,
                part.episodes,
                explore=part.mode == "sampled",
                first_world=REPORTED_WORLDS,
                env=env,
                seed=EVALUATION_SEED,
            )

    labels = {"algorithm": run.algorithm, "training_seed": run.seed}
    yield from _test(run.cell, folder, run.cell.evaluation.modes, labels, play_part)


def test_reference(run: ReferenceRun, folder: RunFolder) -> Iterator[float]:
    """Play the test of a scripted policy, unless it is done; yields the share that is done."""
    tested = run.cell.test_content()
    if folder.is_finished(tested):
        return
    folder.open(run.content(), run.digest())
    folder.note(status=TESTING, digest=run.digest(), run=str(run), **machine())

    def play_part(part: Part, record: Path) -> None:
        with closing(environment(run.cell, copies=1, scenarios=part.scenarios, record=record)) as env:
            played = episodes_in(env, run.policy, EVALUATION_SEED, REPORTED_WORLDS)
            for _ in islice(played, part.episodes):
                pass

    labels = {"algorithm": run.policy, "training_seed": -1}
    yield from _test(run.cell, folder, (SCRIPTED,), labels, play_part)
    folder.note(status=FINISHED, tested=tested)


def _test(
    cell: Cell,
    folder: RunFolder,
    modes: tuple[str, ...],
    given: Mapping[str, Any],
    play_part: Callable[[Part, Path], None],
) -> Iterator[float]:
    parts = [*parts_of(cell, modes)]
    tables = []
    for number, part in enumerate(parts):
        record = folder.episodes / part.name
        shutil.rmtree(record, ignore_errors=True)  # what a test left that was interrupted
        play_part(part, record)
        labels = {**given, "task": cell.task.name, "task_traffic": cell.traffic, "mode": part.mode}
        tables.append(_of_the_test(measure_episodes(record, labels=labels, split=part.split), part.episodes))
        yield (number + 1) / len(parts)
        if not cell.evaluation.keep_episodes:
            shutil.rmtree(record)
    write_table(join_tables(tables), folder.table)
    if not cell.evaluation.keep_episodes:
        shutil.rmtree(folder.episodes, ignore_errors=True)


def _of_the_test(table: Any, episodes: int) -> Any:
    """Leave out the further worlds with which simulations go on that are done before the others."""
    kept = table[table["world"] < REPORTED_WORLDS + episodes].reset_index(drop=True)
    void = int(kept.loc[kept["is_void"], "world"].nunique())
    measured = int(kept["world"].nunique()) - void
    kept.attrs[COUNTS] = {**table.attrs[COUNTS], "measured": measured, "void": void, "incomplete": 0}
    return kept
