"""Adapters of users: those of a spec beside an array adapter, and classes for all agents at once."""

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from smarts.agents import AgentSpec
from smarts.agents.benchmark import benchmark_interface
from smarts.env import RLlibHiWayEnv, VectorHiWayEnv
from smarts.env.adapters import ObservationAndReward

PLAIN = benchmark_interface()
SPACE = Box(-1.0, 100.0, (1,), np.float32)


def speed(observation):
    return np.array([observation.ego_vehicle_state.speed], np.float32)


ADAPTED = AgentSpec(
    interface=PLAIN,
    observation_adapter=speed,
    observation_space=SPACE,
    action_adapter=lambda action: ("slow_down", "keep_lane")[action],
    action_space=Discrete(2),
    reward_adapter=lambda observation, reward: 100.0 + reward,
    info_adapter=lambda observation, reward, info: {"reward": reward, "score": info["score"]},
)


def test_one_agent_by_its_spec_beside_one_by_arrays(closing):
    env = closing(RLlibHiWayEnv({"scenarios": ["loop"], "agent_specs": {"a": PLAIN, "b": ADAPTED}}))
    plain = closing(RLlibHiWayEnv({"scenarios": ["loop"], "agent_specs": {"a": PLAIN, "b": PLAIN}}))
    assert env.observation_spaces["b"] is SPACE
    assert env.action_spaces["b"] == Discrete(2)
    observations, _ = env.reset(seed=4)
    same, _ = plain.reset(seed=4)
    infos = {}
    for _ in range(8):
        assert SPACE.contains(observations["b"])
        np.testing.assert_array_equal(observations["a"], same["a"])
        observations, rewards, _, _, infos = env.step({"a": 0, "b": 1})
        same, expected, *_ = plain.step({"a": 0, "b": 0})
        assert rewards["a"] == expected["a"]
        assert rewards["b"] == pytest.approx(100.0 + expected["b"])
        assert infos["b"]["reward"] == expected["b"]
    assert infos["b"]["score"] > 5.0
    assert observations["b"][0] > 2.0
    for _ in range(12):
        observations, *_ = env.step({"b": 0})
    assert observations["b"][0] < 0.2


class Doubled(ObservationAndReward):
    """The benchmark's, with twice the reward."""

    def __init__(self, context, *given, factor=2.0):
        super().__init__(context, *given)
        self._factor, self._plain = factor, self.rewards
        self.rewards = np.zeros_like(self._plain)

    def collect(self, frame, is_last):
        super().collect(frame, is_last)
        self.rewards[:] = self._factor * self._plain


def test_a_class_serves_all_agents(closing):
    ours = closing(VectorHiWayEnv(2, ["loop"], adapter=Doubled, adapter_options={"factor": 3.0}))
    plain = closing(VectorHiWayEnv(2, ["loop"]))
    ours.reset(5)
    now = plain.reset(5)
    for _ in range(5):
        now, expected = (env.step([np.zeros((2, 4), int)]) for env in (ours, plain))
        np.testing.assert_allclose(now.rewards, 3.0 * expected.rewards, rtol=1e-6)
    assert now.rewards.any()
