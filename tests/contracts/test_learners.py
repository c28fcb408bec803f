"""`VectorHiWayEnv` fulfils the learners' contract."""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import algorithms
from smarts.env import RLlibHiWayEnv, VectorHiWayEnv
from tests.vector_contract import check_vector_env


def different_scenarios(env):
    """Return a seed whose first episodes are in two scenarios, at least one with traffic."""
    for seed in range(20):
        env.reset(seed)
        scenarios = {start.scenario for start in env.episodes}
        if len(scenarios) == 2 and any(start.traffic_name != "no_social_vehicles" for start in env.episodes):
            return seed
    pytest.fail("the scenarios are never side by side")


@pytest.mark.parametrize(
    "options",
    [
        {},
        pytest.param(
            {"observation": {"base": "benchmark", "stacked": [{"image": {"size": 16}}]}},
            marks=pytest.mark.nightly,
        ),
        pytest.param({"observation": "raw"}, marks=pytest.mark.nightly),
    ],
    ids=["vector", "image", "raw"],
)
def test_vector_contract(options):
    """The batch holds two scenarios with traffic."""
    env: Any = VectorHiWayEnv(2, ["intersection", "double_merge"], **options)
    with closing(env):
        check_vector_env(env, steps=60, seed=different_scenarios(env))


def trained(env, env_config=None):
    """Return the result of the second training iteration, and the weights before and after it."""
    config = algorithms.config("ppo").environment(env, env_config=env_config or {})
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=24)
    algo: Any = config.training(sharing="all", hidden=(32,)).build_algo()
    try:
        algo.train()
        before = algo.get_weights()
        return algo.train(), before, algo.get_weights()
    finally:
        algo.stop()


def assert_learnt(result, before, after):
    assert result["env_runners"]["num_env_steps_sampled_lifetime"] == 96
    assert result["env_runners"]["num_failed_envs_lifetime"] == 0
    leaves = [(x, after[module][leaf]) for module, net in before.items() for leaf, x in net.items()]
    assert all(np.isfinite(new).all() for _, new in leaves)
    assert any((old != new).any() for old, new in leaves)


def test_ppo_trains_on_rllibs_face():
    """Environment runners add `num_envs` to the config, which only vector environments use."""
    scenario = Path(__file__).parents[2] / "scenarios" / "intersection"
    assert_learnt(*trained(RLlibHiWayEnv, {"scenarios": [str(scenario)], "agent_specs": 4}))
