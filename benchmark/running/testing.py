"""The test of a policy: recorded episodes, measured into one table."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import pandas as pd

from algorithms.joint.episode_indices import FIRST_TEST_EPISODE
from benchmark.experiment.environment import engine_mark
from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED, Run, ScriptedRun, TaskSetting
from benchmark.metrics import join_tables, measure_episodes, read_table, write_table
from benchmark.metrics.table import COUNTS
from benchmark.results.files import ResultsError, files_in
from benchmark.results.reading import CONDITION, MEETS
from benchmark.results.run_folder import EPISODES, FINISHED, SCENARIOS, TABLE, TESTING, RunFolder
from benchmark.running.environments import environment
from benchmark.running.machine import machine
from benchmark.running.meetings import meetings_in
from benchmark.running.messages import Kept, Message, Noted, RunProgress
from benchmark.running.played import held_out_of, scenario_digests
from benchmark.scripted import SCRIPTED_POLICIES
from benchmark.scripted.play import episodes_of
from smarts.errors import RecordError
from smarts.observations.lists import Observed
from smarts.registry import import_own
from smarts.sim.episode_files import RecordedEpisode, episodes_in

EVALUATION_SEED = 42
"""Root seed of validation and test, the same for all runs: their episodes begin alike."""

ENGINE = "engine"
"""Attribute of tables of `read_test`: the mark of tests on another engine than SUMO."""

MOST_NAMED = 4
"""Most scenarios whose names are in that of a folder of recorded episodes."""

HELD_OUT = "held_out"
"""Split of held-out variations."""
ROUNDS = 5
"""Maximum number of rounds of a part; each later round replaces invalid episodes."""


@dataclass(frozen=True)
class Part:
    """A part of a test."""

    mode: str
    """Action selection: "greedy" or "sampled"; `SCRIPTED` for a scripted policy."""
    scenarios: Mapping[str, float]
    """Scenarios, and the weight of each."""
    episodes: int
    split: str = "train"
    """"train": of what is trained on; "test": a condition of the task's `test`; or "held_out"."""
    condition: str = ""
    """Name of the condition, if the task gives its tests any, perhaps with "(seen)" behind it."""
    traffic: str | None = None
    """Traffic variation of the condition; None: that of the training."""

    @property
    def name(self) -> str:
        """Name of the part's folder."""
        names = [*self.scenarios]
        many = f"{len(names)}-scenarios" if len(names) > MOST_NAMED else "-".join(Path(x).name for x in names)
        return f"{self.mode}-{self.condition.partition(' ')[0] or many}"


def parts_of(task_setting: TaskSetting, modes: tuple[str, ...]) -> Iterator[Part]:
    """Yield the parts of a task setting's test: each mode, then the held-out variations in the first one."""
    evaluation = task_setting.evaluation
    for mode in modes:
        for each in task_setting.task.test:
            scenarios = dict.fromkeys(each.scenarios, 1.0)
            label = f"{each.name} (seen)" if each.seen else each.name
            yield Part(mode, scenarios, evaluation.episodes, "test", condition=label, traffic=each.traffic)
        if not task_setting.task.test:
            yield Part(mode, task_setting.task.trained_on, evaluation.episodes)
    for scenario in held_out_of(task_setting):
        yield Part(modes[0], {scenario: 1.0}, evaluation.held_out_episodes, HELD_OUT)


def play_test(
    run: Run, folder: RunFolder, discount: float, play: Callable[[Any, range, str], object]
) -> Iterator[float]:
    """Play the test of a trained policy and write its table; yields the finished share.

    Args:
        run: The run.
        folder: Folder of the table and the recorded episodes.
        discount: Discount of the learner, with which shaped rewards agree.
        play: Plays the episodes of some indices in an environment that records them, in the mode "greedy" or
            "sampled".
    """
    labels = {"algorithm": run.label, "training_seed": run.seed}
    modes = run.task_setting.evaluation.modes
    yield from play_parts(run.task_setting, folder, modes, labels, play, discount=discount, policy=run.label)


def play_scripted(run: ScriptedRun, scratch: RunFolder) -> Iterator[Message]:
    """Play the test of a scripted policy; yields its results, and progress.

    Args:
        run: The test.
        scratch: Folder for temporary files.
    """
    scenarios = {SCENARIOS: scenario_digests(run.task_setting)}
    yield Noted({"status": TESTING, "run": str(run), **scenarios, **machine()})
    import_own(run.task_setting.imports)
    observation = scripted_observation(run.task_setting, run.policy)

    def play(env: Any, indices: range, mode: str) -> None:
        for _ in islice(episodes_of(env, run.policy, EVALUATION_SEED, indices.start), len(indices)):
            pass

    labels = {"algorithm": run.label, "training_seed": SCRIPTED_SEED}
    seen = {"num_envs": 1, "observation": observation, "policy": run.policy}
    for share in play_parts(run.task_setting, scratch, (SCRIPTED,), labels, play, **seen):
        yield RunProgress(TESTING, share)
    yield from results_of(scratch)
    yield Noted({"status": FINISHED, "tested": run.task_setting.test_content()})


def scripted_observation(task_setting: TaskSetting, policy: str) -> Observed | None:
    """Return the observation that a scripted policy asks for, None if it gets the task setting's."""
    if task_setting.environment.adapter is not None:
        return None  # The experiment's own adapter makes all observations.
    return getattr(SCRIPTED_POLICIES[policy], "observation", None)


def results_of(scratch: RunFolder) -> Iterator[Kept]:
    """Yield the results of a test, in place of those of an earlier one: recorded episodes, then the table."""
    yield Kept(EPISODES, {})
    for episode in sorted(scratch.episodes.glob("*/*")):
        yield Kept(episode.relative_to(scratch.path).as_posix(), files_in(episode))
    yield Kept(TABLE, scratch.table.read_bytes())


def play_parts(
    task_setting: TaskSetting,
    folder: RunFolder,
    modes: tuple[str, ...],
    given: Mapping[str, Any],
    play: Callable[[Any, range, str], object],
    **options: Any,
) -> Iterator[float]:
    """Play and measure all parts, and write the table; yields the finished share.

    Args:
        task_setting: What is played.
        folder: Folder of the table and the recorded episodes.
        modes: Ways of acting.
        given: Columns of the table.
        play: Plays the episodes of some indices in an environment that records them, in one of the modes.
        options: Of the environment.

    Raises:
        ResultsError: Not one episode of a part could be measured.
    """

    def play_part(part: Part, indices: range, record: Path) -> None:
        played = replace(task_setting, traffic=part.traffic or task_setting.traffic)
        with closing(environment(played, scenarios=part.scenarios, record=record, **options)) as env:
            play(env, indices, part.mode)

    parts = [*parts_of(task_setting, modes)]
    tables = []
    for number, part in enumerate(parts):
        labels = {
            **given,
            "task": task_setting.task.name,
            "task_traffic": task_setting.traffic,
            "mode": part.mode,
            **({CONDITION: part.condition} if part.condition else {}),
        }
        tables += measure_part(part, folder.episodes, labels, play_part, task_setting)
        yield (number + 1) / len(parts)
    write_table(join_tables(tables), folder.table)
    if not task_setting.evaluation.keep_episodes:
        shutil.rmtree(folder.episodes, ignore_errors=True)


def read_test(folder: RunFolder, task_setting: TaskSetting) -> pd.DataFrame:
    """Return the table of a test of a task setting, marked by `ENGINE`."""
    table = read_table(folder.table)
    table.attrs[ENGINE] = engine_mark(task_setting.environment.traffic_engine)
    return table


def measure_part(
    part: Part,
    episodes: Path,
    labels: Mapping[str, Any],
    play_part: Callable[[Part, range, Path], None],
    task_setting: TaskSetting,
) -> Iterator[pd.DataFrame]:
    """Yield tables with `part.episodes` valid episodes.

    Each invalid episode is replaced by the one of the next index, so that every policy is tested on the first
    valid episodes of the same sequence. At most `ROUNDS` rounds are played.
    """
    first, lacking, measured = FIRST_TEST_EPISODE, part.episodes, 0
    unread: dict[str, str] = {}
    for number in range(1, ROUNDS + 1):
        record = episodes / (part.name if number == 1 else f"{part.name}-{number}")
        shutil.rmtree(record, ignore_errors=True)  # left by an interrupted test
        indices = range(first, first + lacking)
        play_part(part, indices, record)
        # Metrics know one other split than held-out variations.
        split = HELD_OUT if part.split == HELD_OUT else "train"
        table = measure_episodes(
            record, labels=labels, split=split, metrics=task_setting.metrics or (), indices=indices
        )
        if len(table):
            table["split"] = part.split
            table[MEETS] = meetings_in(record, table)
        counts = table.attrs[COUNTS]
        # Episodes of several parts may have one name.
        counts["corrupted"] = {f"{record.name}/{name}": why for name, why in counts["corrupted"].items()}
        found = counts["measured"] + counts["invalid"] + len(counts["corrupted"])
        counts["incomplete"] = max(0, len(indices) - found)  # episodes without a recording included
        measured += counts["measured"]
        unread |= counts["corrupted"]
        yield table
        if task_setting.evaluation.keep_episodes:
            _remove_others(record, indices)
        else:
            shutil.rmtree(record)
        first, lacking = indices.stop, part.episodes - measured
        if lacking <= 0:
            return
    if not measured:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in unread.items())
        raise ResultsError(
            f"none of {first - FIRST_TEST_EPISODE} test episodes is valid" + (reasons and f": {reasons}"),
            place=str(episodes / part.name),
            remedy="use fewer agents or less traffic: vehicles overlap at the start",
        )


def _remove_others(record: Path, indices: range) -> None:
    """Remove recordings of other episodes, which environments play that finish early."""
    for episode in episodes_in(record):
        with suppress(RecordError):  # the table names damaged episodes, which stay
            if int(RecordedEpisode(episode).facts["world"]) not in indices:
                shutil.rmtree(episode)
