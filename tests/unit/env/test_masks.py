"""Masks of lane actions in the environments by name: in the infos, on request in the observations too."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict

from smarts.env import (
    RLlibHiWayEnv,
    SingleHiWayEnv,
    SingleHiWayVectorEnv,
    VectorHiWayEnv,
    hiway_parallel_env,
)

RIGHT = 3
SEED = 3


def made(kind, **options):
    """Return an environment with four agents of the benchmark."""
    if kind == "parallel":
        return hiway_parallel_env(["double_merge"], 4, **options)
    return RLlibHiWayEnv({"scenarios": ["double_merge"], "agent_specs": 4, **options})


@pytest.mark.parametrize(("kind", "in_observations"), [("parallel", False), ("rllib", True)])
def test_observations_and_masks_are_those_of_the_vector_environment(closing, kind, in_observations):
    options = {"action_mask": True} if in_observations else {}
    env = closing(made(kind, **options))
    vector = closing(VectorHiWayEnv(1, ["double_merge"], 4))
    observations, infos = env.reset(seed=SEED)
    there: Any = vector.reset(SEED)
    ended, masked = set(), 0
    rng = np.random.default_rng(0)
    for _ in range(60):
        seen, masks = there.observations[0][""], there.masks[0]
        if there.reset.any():
            seen, masks = there.final.observations[0][""], there.final.masks[0]
        for name, observation in observations.items():
            place = vector.agents.index(name)
            assert env.observation_spaces[name].contains(observation)
            mask = infos[name]["action_mask"]
            np.testing.assert_array_equal(mask, masks[0, place])
            assert mask[env.action_spaces[name].sample(mask)]  # NumPy's type is the one that Gymnasium takes
            masked += mask.sum() < 4
            if in_observations:
                np.testing.assert_array_equal(observation["action_mask"], mask)
                observation = observation["observation"]
            np.testing.assert_array_equal(observation, seen[0, place])
        if there.reset.any():
            break
        actions = rng.integers(0, 4, 4)
        chosen = {name: actions[vector.agents.index(name)] for name in observations}
        observations, _, terminated, _, infos = env.step(chosen)
        ended |= {name for name, is_over in terminated.items() if is_over and name != "__all__"}
        there = vector.step([actions[None]])
    assert ended
    assert masked > 10


def test_an_observation_without_the_mask_gets_it_where_it_is_asked_for(closing):
    speed = Box(-1.0, 1.0, (1,), np.float32)
    plain = closing(SingleHiWayEnv(["loop"], observation=["speed"]))
    assert plain.observation_space == speed
    assert plain.reset(seed=SEED)[1] == {}
    masked = closing(SingleHiWayEnv(["loop"], observation=["speed"], action_mask=True))
    assert masked.observation_space == Dict({"observation": speed, "action_mask": Box(0, 1, (4,), np.int8)})
    observation, info = masked.reset(seed=SEED)
    np.testing.assert_array_equal(observation["action_mask"], info["action_mask"])
    assert info["action_mask"][0] == 1
    both = closing(SingleHiWayVectorEnv(2, ["loop"], observation=["speed"], action_mask=True))
    assert both.single_observation_space == masked.observation_space
    assert both.reset(seed=SEED)[1]["action_mask"].shape == (2, 4)


def test_an_illegal_lane_change_is_keep_lane(closing):
    """There is no lane to the right."""
    changing, keeping = closing(SingleHiWayEnv(["loop"])), closing(SingleHiWayEnv(["loop"]))
    _, info = changing.reset(seed=SEED)
    keeping.reset(seed=SEED)
    for _ in range(30):
        illegal = int(np.flatnonzero(info["action_mask"] == 0)[-1])
        assert illegal == RIGHT
        *one, info = changing.step(illegal)
        *other, _ = keeping.step(0)
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1:] == other[1:]
