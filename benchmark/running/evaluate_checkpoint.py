"""Evaluates the checkpoint of a run, in the same or in other traffic and scenarios."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import pandas as pd

from benchmark.experiment.config import Evaluation, TrainingTask
from benchmark.experiment.environment import Environment
from benchmark.experiment.values import name_of
from benchmark.results.run_folder import RunFolder, changed_code
from benchmark.running.evaluation_folder import check_free, evaluation_folder
from benchmark.running.importing import named_own_code
from benchmark.running.played import scenario_digests
from benchmark.running.policy import Policy, read_run
from benchmark.running.testing import EVALUATION_SEED, play_test, read_test
from smarts.config import fitted
from smarts.errors import SmartsError
from smarts.sstudio.build import build_scenario


def evaluate_checkpoint(
    path: Path,
    *,
    scenarios: Sequence[str] = (),
    traffic: str | None = None,
    episodes: int = 50,
    modes: tuple[Literal["greedy", "sampled"], ...] = ("greedy", "sampled"),
    checkpoint: Literal["last", "best"] = "last",
    agents: int | None = None,
    engine: str | None = None,
    out: Path | None = None,
    imports: Sequence[str | Path] = (),
) -> pd.DataFrame:
    """Return the table of a test of a run's policy, for `benchmark.metrics.compute`.

    Args:
        path: The run's folder, which is not changed.
        scenarios: Scenarios to play, by default the training's.
        traffic: Traffic to play, by default the training's.
        episodes: Number of episodes for each mode.
        modes: Ways of acting.
        checkpoint: The last, or the best in validation.
        agents: Number of agents, by default the training's; networks that agents share are of any number.
        engine: Traffic engine, by default that of the training's tests.
        out: Folder for the table and the recorded episodes: new, empty, or of the same evaluation.
        imports: Files and folders of own code, by default the ones of the training.

    Raises:
        ResultsError: There is no run or no such checkpoint, or it is damaged; or `out` holds something else.
        SmartsError: A scenario or its traffic does not exist (a `ConfigError` where one has a wrong name).
        CheckpointError: The run's algorithm, or a setting of its networks, is another now.
        SpaceError: The scenarios have other agents than the training, or these see or do something else.
        OwnCodeError: Own code cannot be imported, or raises.
    """
    check_free(out)  # before anything is loaded
    folder = RunFolder(path)
    trained = read_run(folder, imports)
    task = trained.task_setting.task
    if scenarios:
        task = fitted({"name": name_of(scenarios), "scenarios": [*scenarios]}, TrainingTask, "--scenario")
    evaluation = Evaluation(episodes=episodes, modes=modes, keep_episodes=out is not None)
    asked = {"task": task, "traffic": traffic or trained.task_setting.traffic, "evaluation": evaluation}
    environment = trained.task_setting.environment
    if agents is not None and isinstance(environment.agents, dict):
        raise SmartsError("its agents have names, so there are no others", place="--agents")
    changes = {"agents": agents, "traffic_engine": engine}
    changes = {key: value for key, value in changes.items() if value is not None}
    asked["environment"] = fitted(environment.model_dump() | changes, Environment, str(path))
    run = replace(trained, task_setting=replace(trained.task_setting, **asked))
    for scenario in run.task_setting.task.scenarios:
        build_scenario(scenario).with_traffic([run.task_setting.traffic]).episodes(
            run.task_setting.environment.mission_count
        )
    task_setting = run.task_setting
    changed = [f"the code of {name!r}" for name in changed_code(folder.read_config(), trained.content())]
    if task_setting.traffic == trained.task_setting.traffic and agents is None:
        there = folder.changed_scenarios(scenario_digests(task_setting))
        changed += [f"the scenario {name!r}" for name in there]
    for what in changed:
        print(f"note: {path}: {what} has changed since this run", file=sys.stderr)
    kept = folder.kept(checkpoint)
    evaluated = {
        "policy": str(run),
        "run": str(path.resolve()),
        "checkpoint": checkpoint,
        "scenarios": [*task_setting.task.scenarios],
        "traffic": task_setting.traffic,
        "episodes": episodes,
        "modes": [*modes],
        **changes,
    }
    with evaluation_folder(out, evaluated) as answer, named_own_code("the run's own code"):
        policies = {
            mode: Policy(run, kept, is_sampled=mode == "sampled", seed=EVALUATION_SEED) for mode in modes
        }
        discount = policies[modes[0]].discount
        for _ in play_test(run, answer, discount, lambda env, part, mode: policies[mode].play(env, part)):
            pass
        return read_test(answer, task_setting)
