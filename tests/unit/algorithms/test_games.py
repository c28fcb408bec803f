"""Every algorithm reaches the known score of its games; pass lines lie midway to the failing score.

Scores are of greedy episodes of the fixed evaluation list, with one seed; `perf/games.py` plays several. In
`make test` are one game of `ppo` and, in another file, one of `networked_q`.
"""

import pytest
from rigs import Rig, first, per_step

from tests.games.games import Cues, Product, Target, TwoStep

OFF = {
    "learning_starts": 200,
    "updates_per_step": 0.5,
    "batch_size": 64,
    "epsilon": (1.0, 0.1),
    "epsilon_steps": 2000,
}
RECIPES = {
    "a2c": {"lr": 3e-3},
    "ppo": {"lr": 1e-3},
    "centralised_v": {"lr": 1e-3},
    "dqn": {"lr": 1e-3, **OFF},
    "vdn": {"lr": 1e-3, **OFF},
    "qmix": {"lr": 1e-3, **OFF},
    "maddpg": {"lr": 3e-3, "learning_starts": 200, "updates_per_step": 0.5, "batch_size": 128},
}
CUES = {"ppo": 6_000, "a2c": 12_000, "dqn": 4_000, "centralised_v": 6_000}
TARGET = {"ppo": 16_000, "maddpg": 4_000}
"""Environment steps by algorithm."""


def score(name, game, steps, seed, **settings):
    """Return the mean return per step of each agent, (N,), after `steps` environment steps of training."""
    rig = Rig(name, game, seed=seed, **{**RECIPES[name], **settings})
    rig.learn(steps, 32 if name in ("a2c", "ppo", "centralised_v") else 8)
    return per_step(rig.greedy_episodes(20))


def cues_score(name, seed):
    """Return what each agent earns a step, (N,)."""
    return score(name, Cues, CUES[name], seed, gamma=0.5)


def target_score(name, seed):
    """Return minus each agent's mean square distance to its cue, (N,)."""
    return score(name, Target, TARGET[name], seed, gamma=0.5)


def product_score(seed):
    """Return how often both of MADDPG's agents hit, (N,)."""
    return score("maddpg", Product, 4_000, seed, gamma=0.5)


def two_step_score(name, seed, **settings):
    """Return the team's return in an episode of QMIX's game."""
    explore = {"epsilon": (1.0, 1.0), "gamma": 0.99, "lr": 2e-3, **settings}
    return 4 * score(name, TwoStep, 3_000, seed, **explore).mean()  # half of it per agent, over two steps


@pytest.mark.parametrize("name", first(*CUES))
def test_cues_are_hit_for_the_own_reward(name):
    """Hits 1.0 give -1 a step; a team-sum or swapped reward makes hits 0, and 0 a step."""
    assert (cues_score(name, 1) < -0.5).all()


@pytest.mark.nightly
def test_maddpg_solves_the_product_of_hits():
    """1.0; misaligned agents 0.33, wrong action slot 0.22, no straight-through gradient 0.11."""
    assert (product_score(1) > (1 + 0.33) / 2).all()


@pytest.mark.nightly
@pytest.mark.parametrize("name", TARGET)
def test_continuous_actions_follow_their_cue(name):
    """0 at best; -1/3 for always playing the middle."""
    assert (target_score(name, 1) > -1 / 6).all()


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "expected"), [("qmix", 8), ("vdn", 7)])
def test_qmix_represents_the_two_step_game_and_vdn_does_not(name, expected):
    assert two_step_score(name, 1) == pytest.approx(expected, abs=0.1)
