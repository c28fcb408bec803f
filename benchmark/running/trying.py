"""A short episode that tries users' own code before anything trains."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from benchmark.experiment.environment import Environment
from benchmark.experiment.own_code import own_names
from benchmark.experiment.runs import TaskSetting
from benchmark.metrics import compute, measure_episodes
from benchmark.metrics.table import COUNTS
from benchmark.running.environments import environment
from benchmark.running.importing import named_own_code
from benchmark.running.testing import scripted_observation
from benchmark.scripted.play import ScriptedDrivers
from smarts.env.vector import VectorHiWayEnv
from smarts.registry import import_own, is_own_name

TRIED_STEPS = 30
"""Least steps of the episode."""
TRIED_DECISIONS = 3
"""Number of decisions that each scripted policy makes."""
TRIED_EPISODES = 10
"""Most invalid episodes that are played."""


def try_own_code(task_setting: TaskSetting) -> Any:
    """Play and measure a short episode of a task setting with its own code; return the spaces.

    Raises:
        SmartsError: The environment cannot be made or played, or a metric raises; of own code, with its file
            and line.
    """
    metrics = own_names(task_setting.metrics)
    task_setting = replace(task_setting, environment=_without_ray(task_setting.environment))
    steps = max(TRIED_STEPS, 2 * task_setting.environment.decision_interval)
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as folder:
        record = Path(folder)
        with (
            named_own_code("the environment's own code"),
            closing(environment(task_setting, num_envs=1, record=record, max_episode_steps=steps)) as env,
        ):
            _play_one(env)
        table = measure_episodes(record, metrics=metrics)
    if metrics and table.attrs[COUNTS]["measured"]:
        compute(table, metrics=metrics)
    return env.spaces


def try_scripted(task_setting: TaskSetting, policies: Iterable[str]) -> None:
    """Play some steps of a task setting with each own scripted policy.

    Raises:
        SmartsError: The environment cannot be made or played, or a policy raises or returns no action; with
            file and line of own code.
    """
    import_own(task_setting.imports)
    task_setting = replace(task_setting, environment=_without_ray(task_setting.environment))
    for policy in filter(is_own_name, policies):
        observation = scripted_observation(task_setting, policy)
        with (
            named_own_code(f"the scripted policy {policy!r}"),
            closing(environment(task_setting, num_envs=1, observation=observation, policy=policy)) as env,
        ):
            drivers = ScriptedDrivers(policy, env)
            now = env.reset()
            drivers.begin(np.ones(1, np.bool_))
            for _ in range(TRIED_DECISIONS):
                now = env.step(drivers.act(now, now.alive))
                if now.reset.any() or now.failed:
                    drivers.begin(np.ones(1, np.bool_))


def _without_ray(environment: Environment) -> Environment:
    """Return an environment whose agents act in process in place of actors: Ray does not run yet."""
    hosts = {
        locator: "in_process" if "ray" in (host, getattr(host, "where", "")) else host
        for locator, host in environment.hosts.items()
    }
    return environment.model_copy(update={"hosts": hosts})


def _play_one(env: VectorHiWayEnv) -> None:
    """Play until an episode is valid, at most `TRIED_EPISODES`."""
    env.reset()
    played = 0
    while played < TRIED_EPISODES:
        for shares in env.step([_some_actions(block) for block in env.spaces.blocks]).metrics.values():
            played = TRIED_EPISODES if not shares["invalid"] else played + 1


def _some_actions(block: Any) -> NDArray:
    """Return an action for each agent of a block, shape (1, n, ...)."""
    space = block.action
    actions = np.zeros((1, len(block.agents), *(space.shape or ())), space.dtype)
    return np.clip(actions, space.low, space.high) if isinstance(space, Box) else actions + space.start
