"""`VectorHiWayEnv` fulfils the learners' contract, and records hold the policies' action distributions."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ray.tune import register_env

import algorithms
from algorithms.joint.conformance import check_vector_env
from algorithms.joint.evaluation import evaluate
from smarts.env import RLlibHiWayEnv, VectorHiWayEnv
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in


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
    try:
        check_vector_env(env, steps=60, seed=different_scenarios(env))
    finally:
        env.close()


@pytest.mark.nightly
def test_ppo_learns_from_images_and_its_evaluation_is_recorded(tmp_path):
    def create(config):
        picture = {"base": "benchmark", "stacked": [{"image": {"size": 32}}]}
        record = Options(record=tmp_path)
        return VectorHiWayEnv(config["num_envs"], ["two_way"], observation=picture, simulation=record)

    register_env("pictures", create)
    config = algorithms.config("ppo").environment("pictures").training(sharing="all")
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=32)
    algo: Any = config.build_algo()
    try:
        assert set(algo.env_runner_group.local_env_runner.env.spaces.blocks[0].observation) == {
            "observation",
            "image",
        }
        algo.train()
        steps = []
        evaluate(algo, 2, on_step=steps.append)
    finally:
        algo.stop()
    seen = np.concatenate([step.distributions[0][step.playing >= 0].reshape(-1, 4) for step in steps])
    assert np.unique(seen.round(4), axis=0).shape[0] > 10
    recorded = [RecordedEpisode(path) for path in episodes_in(tmp_path)]
    evaluated = [episode for episode in recorded if episode.facts["world"] in (2_000_000, 2_000_001)]
    assert len(evaluated) == 2
    for episode in evaluated:
        extras, decisions = episode.table("extras"), episode.table("decisions")
        rows_of = {name: extras["name"] == name for name in ("probabilities", "reward")}
        decided = set(zip(decisions["step"].tolist(), decisions["agent_id"].tolist(), strict=True))
        for rows in rows_of.values():
            assert (
                set(zip(extras["step"][rows].tolist(), extras["agent_id"][rows].tolist(), strict=True))
                == decided
            )
        probabilities = np.stack([np.array(values) for values in extras["values"][rows_of["probabilities"]]])
        np.testing.assert_allclose(probabilities.sum(axis=1), 1.0, rtol=1e-5)
        action_mask = decisions["action_mask"][:, None] >> np.arange(4) & 1
        order = np.lexsort((decisions["agent_id"], decisions["step"]))
        extras_order = np.lexsort(
            (extras["agent_id"][rows_of["probabilities"]], extras["step"][rows_of["probabilities"]])
        )
        assert not (probabilities[extras_order] * (1 - action_mask[order])).any()


DRIVERS = ["dqn", "maac", "mf_ac", "mf_q", "networked_q", "commnet", "maddpg"]


def trained(name, env, env_config=None):
    """Return the result of the second training iteration, and the weights before and after it."""
    config = algorithms.config(name).environment(env, env_config=env_config or {})
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=24)
    replay = {"learning_starts": 16, "batch_size": 16, "capacity": 200, "updates_per_step": 0.1}
    known = {setting: value for setting, value in replay.items() if setting in config.setting_names}
    sharing = "none" if name == "networked_q" else "all"
    algo: Any = config.training(sharing=sharing, hidden=(32,), **known).build_algo()
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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppo", *(pytest.param(n, marks=pytest.mark.nightly) for n in DRIVERS)])
def test_the_papers_baselines_train_on_the_intersection(name):
    register_env("crossing", lambda config: VectorHiWayEnv(config["num_envs"], ["intersection"], agents=4))
    assert_learnt(*trained(name, "crossing"))


@pytest.mark.slow
def test_ppo_trains_on_rllibs_face():
    """Environment runners add `num_envs` to the config, which only vector environments use."""
    scenario = Path(__file__).parents[2] / "scenarios" / "intersection"
    assert_learnt(*trained("ppo", RLlibHiWayEnv, {"scenarios": [str(scenario)], "agent_specs": 4}))
