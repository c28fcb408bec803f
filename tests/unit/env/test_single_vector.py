"""Gymnasium's `VectorEnv` for one agent, against Gymnasium's own of single environments."""

from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from smarts.agents import ActionSpaceType, AgentInterface
from smarts.env import SingleHiWayVectorEnv
from smarts.errors import ActionError
from tests.raising import raises

ID = "smarts.env:hiway-single-v0"
SHORT = AgentInterface(action=ActionSpaceType.Lane, max_episode_steps=40)
STEERED = AgentInterface(action=ActionSpaceType.Continuous, max_episode_steps=40)
KINDS = {
    "mask": {"action_mask": True},
    "raw": {"agent": STEERED, "observation": "raw"},
}


def assert_equal(given: Any, expected: Any) -> None:
    if isinstance(expected, dict):
        assert given.keys() == expected.keys()
        for name, part in expected.items():
            assert_equal(given[name], part)
    else:
        np.testing.assert_array_equal(given, expected)


def row(observations: Any, number: int) -> Any:
    if isinstance(observations, dict):
        return {name: row(part, number) for name, part in observations.items()}
    return observations[number]


@pytest.mark.parametrize("kind", KINDS)
def test_the_first_simulation_is_what_gymnasium_makes_of_a_single_one(kind):
    options: dict[str, Any] = {"agent": SHORT, "scenarios": ["two_way", "intersection"], **KINDS[kind]}
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    env: Any = gym.make_vec(ID, num_envs=2, **options)
    other: Any = gym.make_vec(ID, num_envs=1, vectorization_mode="sync", vector_kwargs=same_step, **options)
    try:
        assert env.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
        assert env.single_observation_space == other.single_observation_space
        assert env.single_action_space == other.single_action_space
        assert env.observation_space == batch_space(env.single_observation_space, 2)
        assert env.action_space == batch_space(env.single_action_space, 2)
        env.action_space.seed(1)
        ended = []
        for seed in (3, None):
            (seen, infos), (expected, _) = env.reset(seed=seed), other.reset(seed=seed)
            for _ in range(20):
                assert env.observation_space.contains(seen)
                assert_equal(row(seen, 0), row(expected, 0))
                actions = env.action_space.sample()
                seen, rewards, *dones, infos = env.step(actions)
                expected, others, *ends, facts = other.step(actions[:1])
                assert rewards[0] == others[0]
                assert [done[0] for done in dones] == [end[0] for end in ends]
                assert infos.get("action_mask", [None])[0] == pytest.approx(
                    facts.get("action_mask", [None])[0]
                )
                over = dones[0] | dones[1]
                assert ("final_obs" in infos) == over.any()
                if over.any():
                    np.testing.assert_array_equal(infos["_final_obs"], over)
                    np.testing.assert_array_equal(infos["_final_info"], over)
                    np.testing.assert_array_equal(infos["final_info"]["_outcome"], over)
                    assert [each is not None for each in infos["final_obs"]] == over.tolist()
                if over[0]:
                    ended.append(infos["final_info"]["outcome"][0])
                    assert_equal(infos["final_obs"][0], facts["final_obs"][0])
                    assert ended[-1] == facts["final_info"]["outcome"][0]
                    for name in {"action_mask", "_action_mask"} & facts["final_info"].keys():
                        assert_equal(infos["final_info"][name][0], facts["final_info"][name][0])
        assert len(ended) >= 4
        assert "time_out" in ended
    finally:
        env.close()
        other.close()


def test_arrays_stay_as_they_were_returned():
    with closing(SingleHiWayVectorEnv(2, ["loop"], action_mask=True)) as env:
        kept: Any = env.reset(seed=1)
        before = repr(kept)
        env.step(np.zeros(2, int))
        assert repr(kept) == before


def test_what_is_refused():
    env = SingleHiWayVectorEnv(2, ["loop"])
    env.reset()
    for wrong in (0, [0, [1, 2]]):
        with raises(ActionError, values=[(2, 1)]):
            env.step(wrong)  # type: ignore[arg-type]
    env.close()
