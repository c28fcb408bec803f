"""Compiling the kernels by running what users run, for a few steps each, so that no list of types is kept."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.metrics.table import measure_episodes
from benchmark.scripted.play import episodes_of
from smarts.agents.interface import AgentInterface, AgentType
from smarts.controllers import action_space
from smarts.dynamics import MODELS, TYRE_MODELS
from smarts.env.hiway import HiWayEnv
from smarts.env.vector import VectorHiWayEnv
from smarts.sim.options import Options
from smarts.types.actions import ActionSpaceType

SCENARIO = "intersection"
STEPS = 6
"""Decisions of an environment. A kernel is compiled with all kernels that it may call."""


def kernel_users(*, only_experiments: bool = False) -> Mapping[str, Callable[[], None]]:
    """Return short runs of everything that has kernels, by name, or of what most experiments use."""
    runs: dict[str, Callable[[], None]] = {
        "benchmark observation": _benchmark,
        "observation and reward of version 1": partial(_benchmark, observation="neighbor_rows", reward="v1"),
        "recording and metrics": _measured,
    }
    if only_experiments:
        return runs
    runs |= {
        "image and the paper's reward": partial(
            _benchmark, observation={"base": "benchmark", "stacked": ["image"]}, reward="paper"
        ),
        "traffic of Native": partial(_benchmark, simulation=Options(traffic_engine="Native")),
        "all sensors": partial(_drive, AgentInterface.from_type(AgentType.Full, occlusion_map=True)),
    }
    for action in ActionSpaceType:
        runs[f"action {action.name}"] = partial(_drive, AgentInterface(action=action))
    for model in MODELS:
        for tyres in TYRE_MODELS:
            interface = AgentInterface(action=ActionSpaceType.Lane, vehicle_model=model, tyre_model=tyres)
            runs[f"vehicle {model}, {tyres} tyres"] = partial(_drive, interface)
    return runs


def _benchmark(**options: Any) -> None:
    env = VectorHiWayEnv(1, [SCENARIO], **options)
    with closing(env):
        env.reset(seed=1)
        for _ in range(STEPS):
            env.step([np.zeros((1, len(env.agents)), np.int64)])


def _measured() -> None:
    with tempfile.TemporaryDirectory() as folder:
        env = VectorHiWayEnv(1, [SCENARIO], reward="benchmark", simulation=Options(record=Path(folder)))
        with closing(env):
            next(episodes_of(env, "random", 1, 0))
        measure_episodes(folder)


def _drive(interface: AgentInterface) -> None:
    """Drive one agent, which first does not answer, and then acts at random."""
    env = HiWayEnv([SCENARIO], {"agent": interface})
    kind = ActionSpaceType.Empty if interface.action is None else interface.action
    space = action_space(kind)
    space.seed(1)
    with closing(env):
        env.reset(seed=1)
        observations, *_ = env.step({})
        for _ in range(STEPS):
            observations, *_ = env.step({name: space.sample() for name in observations})
