"""Cross-play and robustness of an experiment's policies: checked as a whole, then played in turn."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.experiment.conditions import AS_TRAINED, condition
from benchmark.experiment.config import Evaluation
from benchmark.experiment.own_code import own_digests
from benchmark.experiment.runs import OWN_CODE, TaskSetting
from benchmark.metrics import join_tables, write_table
from benchmark.metrics.results import Frame
from benchmark.metrics.table import COUNTS
from benchmark.results.files import ResultsError, locked, read_versioned, write_versioned
from benchmark.results.robustness import (
    CONDITION,
    PARTNER,
    PLAY,
    ROBUSTNESS,
    TABLE,
    Play,
    read_play,
    trained_state,
)
from benchmark.results.run_folder import RunFolder
from benchmark.results.run_tables import RATES
from benchmark.running.environments import environment
from benchmark.running.importing import named_own_code
from benchmark.running.machine import machine
from benchmark.running.playing_together import (
    Agents,
    ObservationsOfBoth,
    ScriptedDriver,
    TrainedDriver,
    play_together,
)
from benchmark.running.policy import Policy
from benchmark.running.robustness_checks import Cell, Given, cells_of
from benchmark.running.side_by_side import side_by_side
from benchmark.running.testing import EVALUATION_SEED, Part, measure_part
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.errors import SmartsError
from smarts.registry import import_own


def play_robustness(root: Path, given: Given, parallel: int | None = 1) -> Iterator[str]:
    """Play all pairs of policies and all conditions that are not there yet.

    Args:
        root: The experiment's results.
        given: What is asked for.
        parallel: Plays at a time, see `side_by_side`.

    Yields:
        A line for each play, when it is there.

    Raises:
        SmartsError: Something of it cannot be played; raised before anything is.
    """
    cells = cells_of(root, given)
    with locked(root / ROBUSTNESS):
        facts = machine()
        plays = [(cell, play) for cell in cells for play in plays_of(cell, given)]
        _keep_longer(root, plays)
        missing, there = [], 0
        for cell, play in plays:
            wanted = _wanted(cell, play)
            if _is_there(root / play.folder, {**wanted, "commit": facts["commit"]}):
                there += 1
                yield f"{there}/{len(plays)} {play}: was there"
            else:
                missing.append((root, cell, play, {**wanted, **facts}))
        for number, _ in side_by_side(_play, missing, parallel):
            there += 1
            yield f"{there}/{len(plays)} {missing[number][2]}"


def _keep_longer(root: Path, plays: Sequence[tuple[Cell, Play]]) -> None:
    """Raise if plays of more episodes would be replaced."""
    for cell, play in plays:
        file = root / play.folder / PLAY
        found = read_versioned(file)["episodes"] if file.exists() else 0
        if found > cell.episodes:
            raise ResultsError(
                f"a play of {found} episodes would be replaced by one of {cell.episodes}",
                place=str(file.parent),
                remedy=f"give --episodes {found}, or remove {root / ROBUSTNESS}",
            )


def plays_of(cell: Cell, given: Given) -> Iterator[Play]:
    """Yield all pairs in both arrangements, then every policy by itself under each condition."""
    place = cell.task, cell.traffic
    for one, other in itertools.combinations(cell.names, 2):
        if one in cell.runs or other in cell.runs:  # tests of scripted policies alone say nothing here
            yield Play(*place, AS_TRAINED, one, other, cell.seed)
            yield Play(*place, AS_TRAINED, other, one, cell.seed)
    for name in given.conditions:
        for policy in cell.names:
            yield Play(*place, name, policy, policy, cell.seed)


def _wanted(cell: Cell, play: Play) -> dict[str, Any]:
    return {
        **{"task": play.task, "traffic": play.traffic, "condition": play.condition},
        **{"even": play.even, "odd": play.odd, "episodes": cell.episodes, "training_seed": cell.seed},
        "environment": {} if play.condition == AS_TRAINED else condition(play.condition).environment,
        "trained": {name: trained_state(cell.runs[name]) for name in play.drivers if name in cell.runs},
        OWN_CODE: own_digests(
            cell.setting.imports, [cell.scripted[name] for name in play.drivers if name in cell.scripted]
        ),
    }


def _is_there(folder: Path, wanted: Mapping[str, Any]) -> bool:
    """Return whether a play is there, with its rows, by the same code and checkpoints."""
    try:
        found = read_versioned(folder / PLAY)
        read_play(folder)
    except SmartsError:
        return False
    return wanted.items() <= found.items()


def _play(root: Path, cell: Cell, play: Play, facts: Mapping[str, Any]) -> None:
    """Play and measure the episodes, and write rows, then facts, without which a play does not count."""
    import_own(cell.setting.imports)  # this may be a process of its own
    (root / play.folder / PLAY).unlink(missing_ok=True)
    policies = {name: _policy(root, cell, name) for name in play.drivers if name in cell.runs}
    setting = _setting(cell, play)

    def play_part(part: Part, indices: range, record: Path) -> None:
        discount = next((policy.discount for policy in policies.values()), None)
        name = play.even if play.even == play.odd else f"{play.even}+{play.odd}"
        given = {"record": record, "discount": discount, "policy": name, **_observations(cell, play)}
        with closing(environment(setting, scenarios=part.scenarios, **given)) as env:
            play_together(env, _drivers(env, play, cell, policies), indices)

    doing = f"a policy of {play}"
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as scratch, named_own_code(doing):
        part = Part("greedy", setting.task.scenarios, cell.episodes)
        labels = {"algorithm": "", "training_seed": cell.seed, "task": play.task}
        labels |= {"task_traffic": play.traffic, "mode": "greedy", PARTNER: "", CONDITION: play.condition}
        table = join_tables([*measure_part(part, Path(scratch), labels, play_part, setting)])
    write_table(_by_driver(table, play, _at_even_places(setting)), root / play.folder / TABLE)
    needing = [name for name, policy in policies.items() if policy.needs_others]
    write_versioned(root / play.folder / PLAY, {**facts, "needs_others": needing})


def _policy(root: Path, cell: Cell, name: str) -> Policy:
    checkpoint = RunFolder(root / cell.runs[name].place).kept("last")
    return Policy(cell.trained[name], checkpoint, is_sampled=False, seed=EVALUATION_SEED)


def _setting(cell: Cell, play: Play) -> TaskSetting:
    """Return how a play is simulated and measured."""
    given = cell.setting.environment
    return replace(
        cell.setting,
        environment=given if play.condition == AS_TRAINED else condition(play.condition).of(given),
        evaluation=Evaluation(episodes=cell.episodes, modes=("greedy",)),
        metrics=RATES,
    )


def _observations(cell: Cell, play: Play) -> dict[str, Any]:
    """Return arguments of an environment in which a scripted policy sees what it does in its own test."""
    scripted = [cell.scripted[name] for name in play.drivers if name in cell.scripted]
    wanted = getattr(SCRIPTED_POLICIES[scripted[0]], "observation", None) if scripted else None
    if wanted is None or cell.setting.environment.adapter is not None:
        return {}
    return {"adapter": ObservationsOfBoth, "adapter_options": {"scripted": wanted}}


def _drivers(env: Any, play: Play, cell: Cell, policies: Mapping[str, Policy]) -> list[tuple[Any, Agents]]:
    """Return the drivers of an environment's agents, with the agents of each."""

    def driver(name: str, agents: Agents) -> tuple[Any, Agents]:
        if name in policies:
            return TrainedDriver(policies[name], agents, env), agents
        return ScriptedDriver(cell.scripted[name], agents, env), agents

    if play.even == play.odd:
        return [driver(play.even, np.ones(len(env.agents), np.bool_))]
    even = np.isin(env.agents, _at_even_places(cell.setting))
    return [driver(play.even, even), driver(play.odd, ~even)]


def _at_even_places(setting: TaskSetting) -> list[str]:
    """Return the agents at even places of the experiment: the first, the third, and so on."""
    return [*setting.environment.driving()][::2]


def _by_driver(table: Frame, play: Play, even: Sequence[str]) -> Frame:
    """Return the rows with each agent's policy as `algorithm`, and that of the other agents as `partner`."""
    is_even = table["agent"].isin([*even])
    drivers = np.where(is_even, play.even, play.odd)
    partners = np.where(is_even, play.odd, play.even)
    answer = table.assign(**{"algorithm": drivers, PARTNER: partners})
    answer.attrs[COUNTS] = table.attrs[COUNTS]
    return answer
