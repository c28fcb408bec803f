"""Standardised rewards of teams."""

import numpy as np
import pytest
import torch
from rigs import Rig, cases, moved, takes

import algorithms
from tests.games.games import Cues, Ragged

TEAMS = cases([name for name in algorithms.names() if takes(name, standardize_rewards=True)])
REPLAY = {"learning_starts": 1, "batch_size": 32, "capacity": 1000}


def team_rewards(rollout):
    """Return the sums over active agents where any is active."""
    alive = rollout.views.alive[:-1]
    return np.where(alive, rollout.rewards, 0).sum(-1)[alive.any(-1)]


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_rewards_are_standardised_by_all_that_was_seen_while_replay_holds_it(scale):
    settings = {**REPLAY, "capacity": 100_000, "reward_scale": scale}
    rig = Rig("vdn", Ragged, standardize_rewards=True, **settings)
    seen = []
    for steps in (40, 8, 24):
        rollout = rig.rollout(steps, epsilon=1.0)
        rig.learner.update_joint(rollout)
        seen.append(team_rewards(rollout))
    every = np.concatenate(seen)
    assert every.std() > 0.1
    batch = rig.learner.replay.batch(np.arange(len(every)), "cpu")
    expected = scale * (every - every.mean()) / every.std()
    np.testing.assert_allclose(rig.learner.reward(batch), expected, rtol=0, atol=0.01 * scale)


def test_older_rollouts_weigh_less_by_the_capacity():
    rig = Rig("vdn", Ragged, standardize_rewards=True, **REPLAY | {"capacity": 50})
    means, squares, weights = [], [], []
    for steps in (40, 8, 24):
        rollout = rig.rollout(steps, epsilon=1.0)
        rig.learner.update_joint(rollout)
        rewards = team_rewards(rollout)
        kept = np.exp(-len(rewards) / 50)
        weights = [weight * kept for weight in weights] + [1 - kept]
        means.append(rewards.mean())
        squares.append(np.square(rewards).mean())
    mean, square = (np.average(each, weights=weights) for each in (means, squares))
    batch = rig.learner.replay.batch(np.arange(20), "cpu")
    total = np.where(batch.alive, batch.rewards, 0).sum(-1)
    expected = (total - mean) / np.sqrt(square - mean**2)
    np.testing.assert_allclose(rig.learner.reward(batch), expected, rtol=1e-4, atol=1e-5)


class OtherUnits(Cues):
    """Cues, with another unit and another zero of the rewards."""

    def reward(self, actions):
        return [8 * own - 16 for own in super().reward(actions)]


@pytest.mark.parametrize("standardize", [True, False])
@pytest.mark.parametrize("name", TEAMS)
def test_units_and_zero_of_rewards_change_nothing_only_if_standardised(name, standardize):
    one, other = (
        Rig(name, game, standardize_rewards=standardize, **REPLAY, grad_clip=None)
        for game in (Cues, OtherUnits)
    )
    before = one.weights()
    for rig in (one, other):
        for _ in range(3):
            rig.learner.update_joint(rig.rollout(16, epsilon=1.0, temperature=1.0))
    assert moved(before, one.weights())
    ours, theirs = one.weights(), other.weights()
    same = all(
        torch.allclose(weight, theirs[module][key], rtol=0, atol=1e-5)
        for module, own in ours.items()
        for key, weight in own.items()
        if not key.startswith("moments")  # of MAVEN's returns
    )
    assert same == standardize


@pytest.mark.parametrize("name", TEAMS)
def test_moments_are_restored_to_the_last_bit(name):
    rig, other = (Rig(name, Cues, seed=seed, standardize_rewards=True, **REPLAY) for seed in (1, 2))
    rig.learner.update_joint(rig.rollout(24, epsilon=1.0, temperature=1.0))
    other.learner.set_state(rig.learner.get_state())
    for key, moment in rig.learner.reward_moments.state_dict().items():
        assert moment != 0
        assert torch.equal(moment, other.learner.reward_moments.state_dict()[key])
    rollout = rig.rollout(24, epsilon=1.0, temperature=1.0)
    for one in (rig, other):
        one.learner.update_joint(rollout)
    assert moved(rig.weights(), other.weights()) == set()
