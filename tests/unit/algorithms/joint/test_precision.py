"""Observations of other floating-point numbers than float32 are cast once, where they enter."""

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from rigs import Rig, known

from algorithms.joint.finite import non_finite
from tests.games.games import Cues, Ragged

REPLAY = {"learning_starts": 8, "capacity": 200, "batch_size": 16, "updates_per_step": 0.5}


def precise(game, dtype):
    """Return a game that shows the same numbers in another precision."""

    class Precise(game):
        def __init__(self, config=None):
            super().__init__(config)
            shapes = {a: space.shape for a, space in self.observation_spaces.items()}
            self.observation_spaces = {
                a: Box(-np.inf, np.inf, shape, np.dtype(dtype).type) for a, shape in shapes.items()
            }

        def reset(self, **given):
            seen, infos = super().reset(**given)
            return self.cast(seen), infos

        def step(self, action_dict):
            seen, *rest = super().step(action_dict)
            return (self.cast(seen), *rest)

        def cast(self, seen):
            return {a: x.astype(dtype) for a, x in seen.items()}

    return Precise


def learned(name, game):
    rig = Rig(name, game, seed=1, **known(name, REPLAY))
    before = rig.weights()
    for _ in range(2):
        rig.learner.update_joint(rig.rollout(24, epsilon=0.5))
    after = rig.weights()
    assert any(not torch.equal(before[m][k], after[m][k]) for m in after for k in after[m])
    return after


@pytest.mark.parametrize("name", ["ppo", "dqn"])
def test_doubles_are_learned_from_alike(name):
    """Ragged's final observations differ from those after the reset, and its agents come and go."""
    single, double = learned(name, Ragged), learned(name, precise(Ragged, np.float64))
    for module, own in single.items():
        for key, weight in own.items():
            torch.testing.assert_close(double[module][key], weight, rtol=0, atol=0)


class Huge(precise(Cues, np.float64)):
    """Shows, after four steps, a number that float32 does not hold."""

    def cast(self, seen):
        return {a: np.where(self.t == 4, 1e300, x.astype(np.float64)) for a, x in seen.items()}


def test_a_number_beyond_float32_is_a_failure_of_the_environment():
    rollout = Rig("ppo", Huge).rollout(8)
    assert rollout.failed.sum() == 2 * 2  # step 4 of both environments, and of those that replace them
    assert np.isfinite(rollout.views.observations[0][""]).all()


def test_a_number_that_is_not_finite_is_named_with_its_agent():
    step = Rig("ppo", Cues).env.reset(0, np.arange(2))
    rewards = step.rewards.copy()
    rewards[1, 0] = np.nan
    seen = {"": step.observations[0][""].copy()}
    seen[""][0, 1, 2] = np.inf
    found = non_finite(step._replace(rewards=rewards, observations=(seen,)), ("x", "y"))
    assert {b: str(error) for b, error in found.items()} == {
        0: "NaN or infinity: observation of agent 'y'",
        1: "NaN or infinity: reward of agent 'x'",
    }
    assert not non_finite(step, ("x", "y"))
