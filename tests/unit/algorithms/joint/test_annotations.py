"""What samplers tell environments that record: what each step's actions were sampled from."""

import numpy as np

from algorithms.joint.adapter import JointVector
from algorithms.parts.distributions import Exploration
from tests.games.games import Cues, Target
from tests.unit.algorithms.rigs import Rig


class Recording(JointVector):
    """Keeps the annotations before each step, and the step's actions."""

    def __init__(self, game):
        super().__init__(lambda b: game({}), 2)
        self.told, self.steps = {}, []

    def annotate(self, name, values):
        self.told[name] = [None if each is None else each.copy() for each in values]

    def step(self, actions):
        self.steps.append((self.told, [each.copy() for each in actions]))
        self.told = {}
        return super().step(actions)


def steps_of(game, explore):
    """Return what was told and done in steps of training, and in those of an evaluation."""
    env = Recording(game)
    rig = Rig("ppo", env)
    rig.rollout(6)
    trained, env.steps = env.steps, []
    rig.sampler.episodes(np.arange(2), Exploration(explore=explore))
    assert len(trained) == 6
    return trained, env.steps


def test_continuous_actions_come_with_their_mean_and_deviation():
    trained, evaluated = steps_of(Target, explore=False)
    for told, actions in (*trained, *evaluated):
        assert {*told} == {"mean", "std"}
        for mean, std, action in zip(told["mean"], told["std"], actions, strict=True):
            assert mean.shape == std.shape == action.shape
            assert (std > 0).all()
    for told, actions in evaluated:
        # The policy acts by its mean; -1 to 1 are the bounds, 0 to 4.
        for mean, action in zip(told["mean"], actions, strict=True):
            np.testing.assert_allclose(action, np.clip(2 * (mean + 1), 0, 4), rtol=1e-5)


def test_discrete_actions_come_with_their_probabilities():
    trained, evaluated = steps_of(Cues, explore=False)
    for told, _ in (*trained, *evaluated):
        assert {*told} == {"probabilities"}
        for each in told["probabilities"]:
            np.testing.assert_allclose(each.sum(-1), 1.0, rtol=1e-5)
    for told, actions in evaluated:
        for probabilities, action in zip(told["probabilities"], actions, strict=True):
            np.testing.assert_array_equal(action, probabilities.argmax(-1))
