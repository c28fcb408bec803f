"""Evaluates trained policies in any scenario, and agents of the zoo or at an address in their place."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Evaluation, TestCondition, TrainingTask
from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED, TaskSetting
from benchmark.experiment.values import name_of
from benchmark.results.files import check_free, new_folder
from benchmark.results.release import check_released
from benchmark.results.run_folder import RunFolder, changes_since
from benchmark.running.importing import named_own_code
from benchmark.running.played import build_played, tested_digests
from benchmark.running.playing_together import play_together
from benchmark.running.policy import Policy, read_run
from benchmark.running.testing import EVALUATION_SEED, play_parts, play_test, read_test
from benchmark.running.trained import check_suite, trained_on
from smarts.agents.hosting.remote import RemoteAgent
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.config import fitted
from smarts.env.groups import ALONE
from smarts.env.vector import VectorHiWayEnv, VectorStep
from smarts.errors import OwnCodeError, SmartsError
from smarts.registry import file_name, import_own
from smarts.types.actions import LaneAction
from smarts.types.streams import hold_seed
from smarts.zoo import make_agent
from smarts.zoo.exported import ExportedPolicy
from smarts_agent_kit.exported import TEAM
from smarts_agent_kit.service import WrongActionsError, checked_actions

TRAFFIC, AGENTS = "random_social_vehicles", 4
"""What agents are tested in, if nothing else is asked for."""
MOST_NOTES = 4
"""Largest number of changes since a training that are listed."""


@dataclass(frozen=True)
class Asked:
    """How a policy or an agent is tested."""

    scenarios: Sequence[str] = ()
    """What is played, by default the conditions of the policy's test, or what it was trained on."""
    traffic: str | None = None
    """Variation of their traffic, by default that of the conditions, or of the training."""
    episodes: int = 50
    """Number of episodes for each mode and condition."""
    agents: int | None = None
    """Number of egos, by default the training's, or 4."""
    engine: str | None = None
    """Traffic engine, by default that of the training's tests, or SUMO."""
    out: Path | None = None
    """Folder for the table and the recorded episodes: new or empty."""
    imports: Sequence[str | Path] = ()
    """Files and folders of own code, by default the ones of the training."""

    @property
    def changes(self) -> dict[str, Any]:
        """What differs from the environment of a training."""
        changes = {"agents": self.agents, "traffic_engine": self.engine}
        return {key: value for key, value in changes.items() if value is not None}

    def play(
        self,
        task: TrainingTask,
        traffic: str,
        environment: Environment,
        agent: BatchAgent,
        labels: Mapping[str, Any],
        mode: str,
    ) -> pd.DataFrame:
        """Let an agent play the test of a task; return its table, with these labels."""
        evaluation = Evaluation(episodes=self.episodes, keep_episodes=self.out is not None)
        own = tuple(str(Path(each).absolute()) for each in self.imports)
        setting = TaskSetting(task, self.traffic or traffic, environment, evaluation, num_envs=1, imports=own)
        with new_folder(self.out) as folder:
            for share in play_agent(setting, RunFolder(folder), agent, labels, mode=mode):
                print(f"{share:.0%}", file=sys.stderr)
            return read_test(RunFolder(folder), setting)


def evaluate_agent(locator: str, asked: Asked, options: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Return the table of a test of an agent, for `benchmark.metrics.compute`.

    Observation, action, vehicle and period are the agent's; all else is the benchmark's, so that agents are
    judged alike. They play the test episodes of trained policies.

    Args:
        locator: A name of the zoo, "module:name-v0", or "tcp://HOST:PORT".
        asked: What is played; scenarios are needed.
        options: Options of the agent.

    Raises:
        SmartsError: There is no such agent or scenario, or the agent fails, or answers what is no action: a
            score of some of its actions would be none of the agent.
    """
    check_free(asked.out)
    import_own(asked.imports)
    agent, interface = batch_agent(locator, **(options or {}))
    try:
        driven = environment_of(agent, interface, asked.agents or AGENTS, asked.engine, f"agent {locator!r}")
        labels = {"algorithm": file_name(locator), "training_seed": SCRIPTED_SEED}
        with named_own_code(f"the agent {locator!r}"):
            return asked.play(_task_of(asked.scenarios), TRAFFIC, driven, agent, labels, SCRIPTED)
    finally:
        if isinstance(agent, RemoteAgent):
            agent.close()


def batch_agent(locator: str, **options: Any) -> tuple[BatchAgent, AgentInterface]:
    """Return an agent that acts on arrays.

    Raises:
        SmartsError: There is none, or it acts on `Observation` objects.
    """
    agent, interface = make_agent(locator, **options)
    if not isinstance(agent, BatchAgent):
        raise SmartsError(
            "the agent acts on Observation objects",
            place=f"agent {locator!r}",
            remedy="derive it from BatchAgent, which acts on arrays",
        )
    return agent, interface


def environment_of(
    agent: BatchAgent, interface: AgentInterface, agents: int, engine: str | None, place: str
) -> Environment:
    """Return the benchmark's environment with an agent's observation, action, vehicle and period."""
    given = {
        "agents": agents,
        "traffic_engine": engine,
        "action": interface.action.name if interface.action is not None else None,
        "vehicle": interface.vehicle_class,
        "vehicle_model": interface.vehicle_model,
        "tyre_model": interface.tyre_model,
        "flat_tyres": [*interface.flat_tyres],
        "decision_interval": agent.period,
        "observation": [*seen] if isinstance(seen := agent.observation, tuple) else seen,
    }
    return fitted(given, Environment, place)


def _task_of(scenarios: Sequence[str]) -> TrainingTask:
    """Return a task of scenarios, whose name leaves out the "*" of families of maps."""
    name = name_of(each.replace("*", "").rstrip("@-") for each in scenarios)
    return fitted({"name": name, "scenarios": [*scenarios]}, TrainingTask, "--scenario")


def play_agent(
    task_setting: TaskSetting,
    folder: RunFolder,
    agent: BatchAgent,
    labels: Mapping[str, Any],
    *,
    mode: str = SCRIPTED,
    seed: int = EVALUATION_SEED,
) -> Iterator[float]:
    """Play the test of a task setting by an agent and write its table; yields the finished share.

    Args:
        task_setting: What is played; the agent sees its own observation, with the same rewards.
        folder: Folder of the table and the recorded episodes.
        agent: Drives all egos.
        labels: Columns of the table: algorithm and training_seed.
        mode: Column of the table.
        seed: Seed of the episodes.

    Raises:
        SmartsError: The agent fails, or answers what is no action.
    """

    def play(env: VectorHiWayEnv, indices: range, _: str) -> None:
        everyone = np.ones(len(env.agents), np.bool_)
        play_together(env, [(AgentDriver(agent, env), everyone)], indices, seed)

    seen = {"num_envs": 1, "observation": agent.observation, "policy": str(labels["algorithm"])}
    yield from play_parts(task_setting, folder, (mode,), labels, play, **seen)


def evaluate_exported(path: Path, asked: Asked) -> pd.DataFrame:
    """Return the table of a test of an exported policy, each ego driven by its own agent of the training.

    It acts greedily, as its checkpoint does; neither the run's folder nor the learners are needed.

    Args:
        path: The folder that `smarts-bench export` or `release` has written.
        asked: What is played; of agents, the first ones of the training.

    Raises:
        SmartsError: The folder does not hold an exported policy, or does not say what it was trained on, or
            names code or files of its author.
    """
    check_free(asked.out)
    import_own(asked.imports)
    check_released(path)
    trained = trained_on(path)
    if not asked.scenarios:
        check_suite(trained, path)
    given = {
        "name": trained.task,
        "scenarios": trained.scenarios,
        "test": [each.model_dump() for each in trained.test],
    }
    task = asked_task(fitted(given, TrainingTask, str(path)), asked.scenarios, asked.traffic)
    driven = fitted(trained.environment | asked.changes, Environment, str(path))
    labels = {"algorithm": trained.algorithm, "training_seed": trained.seed}
    build_played(task.tested_on)
    return asked.play(task, trained.traffic, driven, ExportedPolicy(path, TEAM), labels, "greedy")


class AgentDriver:
    """An agent that acts on arrays, for all agents of an environment; see `playing_together.Driver`.

    Args:
        agent: The agent.
        env: Its agents have equal spaces, which fit the agent.
    """

    def __init__(self, agent: BatchAgent, env: VectorHiWayEnv) -> None:
        self._agent, self._env = agent, env
        self._episode = np.full(env.num_envs, -1)
        self._known = np.zeros((env.num_envs, len(env.agents)), np.bool_)

    def act(self, now: VectorStep, begun: NDArray[np.bool_]) -> list[NDArray]:
        """Return the actions of all active agents, shape (B, n, ...).

        Raises:
            OwnCodeError: The agent's answer is no action.
        """
        self._known[begun] = False
        self._episode[begun] += 1
        batch = self._batch(now)
        self._known |= now.alive
        block = self._env.spaces.blocks[0]
        chosen = np.zeros((*now.alive.shape, *(block.action.shape or ())), block.action.dtype)
        given = self._agent.act(batch)
        try:
            answer = checked_actions(given, len(batch.env_id))
            is_whole = chosen.dtype.kind not in "iu" or np.array_equal(answer, answer.astype(chosen.dtype))
            if answer.shape[1:] != chosen.shape[2:] or not is_whole:
                raise WrongActionsError(f"answered by {answer.dtype} of shape {answer.shape}")
        except WrongActionsError as error:
            raise OwnCodeError(
                f"the agent {error}",
                place=type(self._agent).__name__,
                remedy=f"give {chosen.dtype} of shape (N, ...) for the action space {block.action}",
            ) from error
        chosen[batch.env_id, batch.agent_id] = answer
        return [chosen]

    def _batch(self, now: VectorStep) -> ActionBatch:
        """Return the request for the actions of the active agents."""
        env, starts = self._env, self._env.episodes
        rows, places = np.nonzero(now.alive)
        (leaves,), (masks,) = now.observations, now.masks
        everything = np.ones((len(rows), len(LaneAction)), np.bool_)
        seeds = [
            hold_seed(
                starts[row].seed, env.agents[place], world=starts[row].world, episode=starts[row].episode
            )
            for row, place in zip(rows.tolist(), places.tolist(), strict=True)
        ]
        hold = (self._episode[rows] * env.num_envs + rows) * len(env.agents) + places
        return ActionBatch(
            observations={name or ALONE: array[rows, places] for name, array in leaves.items()},
            action_mask=everything if masks is None else masks[rows, places],
            env_id=rows.astype(np.int32),
            agent_id=places.astype(np.int32),
            hold=hold.astype(np.int64),
            episode=np.array([starts[row].episode for row in rows.tolist()], np.int32),
            step=env.episode_steps[rows].astype(np.int32),
            is_first=~self._known[rows, places],
            seed=np.array(seeds, np.uint64),
            drives=np.ones(len(rows), np.bool_),
        )


def asked_task(task: TrainingTask, scenarios: Sequence[str], traffic: str | None) -> TrainingTask:
    """Return the task of an evaluation: the training's, with the conditions of its test, or scenarios."""
    if scenarios:
        return _task_of(scenarios)
    if not traffic:
        return task
    test: dict[frozenset[str], TestCondition] = {}
    for each in sorted(task.test, key=lambda each: each.traffic not in (None, traffic)):
        name = each.name if each.traffic == traffic else f"{each.name} ({traffic})"
        # Conditions may have differed in their traffic alone.
        test.setdefault(frozenset(each.scenarios), each.model_copy(update={"name": name, "traffic": None}))
    return task.model_copy(update={"test": tuple(test.values())})


def evaluate_checkpoint(
    path: Path,
    asked: Asked,
    *,
    modes: tuple[Literal["greedy", "sampled"], ...] = ("greedy", "sampled"),
    checkpoint: Literal["last", "best"] = "last",
) -> pd.DataFrame:
    """Return the table of a test of a run's policy, for `benchmark.metrics.compute`.

    Args:
        path: The run's folder, which is not changed.
        asked: What is played; networks that agents share are of any number of them.
        modes: Ways of acting.
        checkpoint: The last, or the best in validation.

    Raises:
        ResultsError: There is no run or no such checkpoint, or it is damaged; or the folder for the episodes
            holds something else.
        SmartsError: A scenario or its traffic does not exist (a `ConfigError` where one has a wrong name).
        CheckpointError: The run's algorithm, or a setting of its networks, is another now.
        SpaceError: The scenarios have other agents than the training, or these see or do something else.
        OwnCodeError: Own code cannot be imported, or raises.
    """
    check_free(asked.out)  # before anything is loaded
    folder = RunFolder(path)
    trained = read_run(folder, asked.imports)
    before = trained.task_setting
    setting = replace(
        before,
        task=asked_task(before.task, asked.scenarios, asked.traffic),
        traffic=asked.traffic or before.traffic,
        evaluation=Evaluation(episodes=asked.episodes, modes=modes, keep_episodes=asked.out is not None),
        environment=fitted(before.environment.model_dump() | asked.changes, Environment, str(path)),
    )
    build_played(setting.task.tested_on)
    is_alike = setting.traffic == before.traffic and asked.agents is None
    changed = changes_since(folder, trained.content(), tested_digests(setting) if is_alike else {})
    for what in changed[:MOST_NOTES]:
        print(f"note: {path}: {what} has changed since this run", file=sys.stderr)
    if more := changed[MOST_NOTES:]:
        print(f"note: {path}: {len(more)} more have changed", file=sys.stderr)
    run, kept = replace(trained, task_setting=setting), folder.kept(checkpoint)
    with new_folder(asked.out) as answer, named_own_code("the run's own code"):
        policies = {
            mode: Policy(run, kept, is_sampled=mode == "sampled", seed=EVALUATION_SEED) for mode in modes
        }
        discount = policies[modes[0]].discount
        for _ in play_test(
            run, RunFolder(answer), discount, lambda env, part, mode: policies[mode].play(env, part)
        ):
            pass
        return read_test(RunFolder(answer), setting)
