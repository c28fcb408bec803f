"""Latents that policies draw at an episode's start, and agents that are sampled jointly."""

import numpy as np
import pytest

from algorithms.joint.env import LATENT
from algorithms.joint.policies import Policies
from algorithms.joint.sampler import Sampler
from algorithms.joint.spec import SPEC, JointSpec
from algorithms.parts.distributions import Exploration
from tests.games.pair import TABLE, PairConfig, Vector


def sampler(num_envs=2, sharing="all", seed=3, config=None, env=None):
    config = (config or PairConfig()).training(sharing=sharing)
    env = env or Vector({"num_envs": num_envs})
    spec = JointSpec.build(env.spaces, config.sharing, config.carried)
    module = config.get_multi_rl_module_spec(spaces={SPEC: (spec, None)}, inference_only=True).build()
    policies = Policies(spec, {g.id: module[g.id] for g in spec.groups})
    return Sampler(env, policies, spec, seed=seed, max_failures=1000)


def latents_of(rollout):
    return rollout.views.observations[0][LATENT]


@pytest.mark.parametrize("sharing", ["all", "none"])
def test_a_latent_lasts_for_its_episode_and_is_recorded(sharing):
    rollout = sampler(sharing=sharing).fragment(12, Exploration())
    latents = latents_of(rollout)
    assert np.array_equal(latents[:, :, 0], latents[:, :, 1])  # one for both agents
    for b in range(2):
        changed = (latents[1:, b, 0] != latents[:-1, b, 0]).any(-1)
        assert np.array_equal(changed, rollout.reset[:, b])
    # What was cut is seen with the latent of its own episode, not of the next.
    for k, (t, b) in enumerate(rollout.final_at):
        assert np.array_equal(rollout.final.observations[0][LATENT][k], latents[t, b])


def test_latents_do_not_depend_on_the_number_of_environments():
    few, many = (latents_of(sampler(count).fragment(12, Exploration())) for count in (2, 5))
    assert np.array_equal(few, many[:, :2])
    assert len(np.unique(many[0, :, 0], axis=0)) == 5
    assert not np.array_equal(few, latents_of(sampler(2, seed=4).fragment(12, Exploration())))


@pytest.mark.parametrize("sharing", ["all", "none"])
def test_actions_are_drawn_from_the_joint_distribution(sharing):
    """Frequencies, and the covariance p(1, 1) - p(a_1 = 1) p(a_2 = 1), which is 0 where agents act alone."""
    rollout = sampler(64, sharing).fragment(200, Exploration())
    actions = rollout.actions[0].reshape(-1, 2)
    count = len(actions)
    frequencies = np.zeros((2, 2))
    np.add.at(frequencies, tuple(actions.T), 1 / count)
    assert np.abs(frequencies - TABLE.numpy()).max() < 4 * np.sqrt(0.25 / count)
    covariance = np.cov(actions.T)[0, 1]
    assert covariance == pytest.approx(0.3 - 0.4 * 0.4, abs=0.02)
    expected = TABLE.log().numpy()[tuple(actions.T)]
    np.testing.assert_allclose(rollout.log_prob.reshape(-1, 2).sum(1), expected, rtol=1e-5)


def test_a_sampler_is_restored_with_its_latents():
    one, other = sampler(), sampler()
    one.fragment(5, Exploration())
    other.set_state(one.get_state())
    first, second = (each.fragment(9, Exploration()) for each in (one, other))
    assert np.array_equal(latents_of(first), latents_of(second))
    assert np.array_equal(first.actions[0], second.actions[0])
    assert first.reset.any()
