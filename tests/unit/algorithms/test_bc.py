"""Behavioural cloning of demonstrations by hand, and policies that keep near to another run's."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from rigs import Rig

from algorithms.bc import DataError, Demonstrations
from algorithms.parts.distributions import CategoricalDistribution, GaussianDistribution
from tests.games.games import Cues, Target


def demonstrated(file, obs, actions, **columns):
    columns = {"obs": list(obs.astype(np.float32)), "actions": pa.array(actions)} | columns
    pq.write_table(pa.table(columns), file)
    return str(file)


def test_a_relation_of_observation_and_action_is_learned(tmp_path):
    cues = np.random.default_rng(1).integers(4, size=500)
    file = demonstrated(tmp_path / "cues", np.eye(4)[cues], (cues + 1) % 4)
    rig = Rig("bc", Cues, data=file, lr=1e-2, batch_size=64)
    rig.learner.update_joint(None)
    rollout = rig.rollout(16, explore=False)
    seen = rollout.views.observations[0][""][:-1].argmax(-1)
    np.testing.assert_array_equal(rollout.actions[0], (seen + 1) % 4)


def test_continuous_actions_are_those_of_the_environment(tmp_path):
    cues = np.random.default_rng(1).uniform(-1, 1, (500, 1))
    file = demonstrated(tmp_path / "target", cues, list((2 + cues).astype(np.float32)))
    rig = Rig("bc", Target, data=file, lr=1e-2, batch_size=64, noise=0.0, updates=400)
    rig.learner.update_joint(None)
    # The game wants 2 * (1 + cue), and gets 2 + cue: half of the cue away.
    rollout = rig.rollout(16, explore=False)
    np.testing.assert_allclose(rollout.actions[0], rollout.views.observations[0][""][:-1] / 2, atol=0.05)


def test_observations_get_noise_and_masked_actions_have_no_share(tmp_path):
    file = demonstrated(tmp_path / "cues", np.eye(4), [1] * 4, action_mask=[[False, True, False, False]] * 4)
    rig = Rig("bc", Cues, data=file, noise=0.5)
    assert rig.learner._noisy(torch.ones(10_000)).std().item() == pytest.approx(0.5, abs=0.02)
    group = rig.learner.groups[0]
    assert rig.learner.loss(group).item() > 1.0
    rig.learner.data = {group.id: Demonstrations.read(file, group, masked=True)}
    assert rig.learner.loss(group).item() == pytest.approx(0.0, abs=1e-6)


def test_data_of_other_agents_are_refused(tmp_path):
    file = demonstrated(tmp_path / "cues", np.zeros((3, 5)), [0, 1, 2])
    with pytest.raises(DataError, match=r"observations of \(5,\)"):
        Rig("bc", Cues, data=file).learner.update_joint()
    with pytest.raises(DataError, match="cannot be read"):
        Rig("bc", Cues, data=str(tmp_path / "none")).learner.update_joint()
    with pytest.raises(DataError, match="no demonstrations"):
        Rig("bc", Cues).learner.update_joint()


def test_divergences_are_those_of_torch():
    draws = torch.Generator().manual_seed(1)
    a, b, c, d = torch.randn(4, 5, 3, generator=draws)
    mask = torch.rand(5, 3, generator=draws) > 0.3
    mask[:, 0] = True
    of = torch.distributions.kl_divergence
    logits = [x.masked_fill(~mask, -1e8) for x in (a, b)]
    expected = of(*(torch.distributions.Categorical(logits=x) for x in logits))
    found = CategoricalDistribution(a, mask).divergence(CategoricalDistribution(b, mask))
    torch.testing.assert_close(found, expected)
    expected = of(torch.distributions.Normal(a, b.exp()), torch.distributions.Normal(c, d.exp())).sum(-1)
    torch.testing.assert_close(GaussianDistribution(a, b).divergence(GaussianDistribution(c, d)), expected)


@pytest.fixture
def reference(tmp_path):
    """The folder of a run whose policy likes the first action."""
    rig = Rig("ppo", Cues, seed=5, sharing="all", identity=False)
    with torch.no_grad():
        rig.learner.net("shared").body[-1].bias.copy_(torch.tensor([2.0, 0.0, -1.0, 0.0]))
    rig.learner.module.save_to_path(tmp_path / "checkpoint/learner_group/learner/rl_module")
    return tmp_path


def probabilities(rig):
    rollout = rig.rollout(4)
    return np.exp(rollout.log_prob), rollout.actions[0]


def test_a_policy_keeps_near_to_another_one(reference):
    liked = torch.softmax(torch.tensor([2.0, 0.0, -1.0, 0.0]), 0).numpy()
    given = {"lr": 1e-2, "kl_to": str(reference), "kl_coeff": 1000.0}
    rig = Rig("ppo", Cues, **given)
    with torch.no_grad():  # by hand: the divergence of equal chances from those liked
        for name in ("agent_0", "agent_1"):
            rig.learner.net(name).body[-1].weight.zero_()
            rig.learner.net(name).body[-1].bias.zero_()
    rig.learner.update_joint(rig.rollout())
    first = float(rig.learner._means["agent_0", "kl_to_reference"][0])
    assert first == pytest.approx(-np.log(4) - np.log(liked).mean(), rel=0.02)
    for _ in range(20):
        rig.learner.update_joint(rig.rollout())
    found, actions = probabilities(rig)
    np.testing.assert_allclose(found, liked[actions], atol=0.05)


def test_without_weight_a_step_is_that_of_ppo(reference):
    weights = []
    for given in ({}, {"kl_to": str(reference), "kl_coeff": 0.0}, {"kl_to": str(reference)}):
        rig = Rig("ppo", Cues, **given)
        rig.learner.update_joint(rig.rollout())
        weights.append(rig.weights()["agent_0"])
    same = [all(torch.equal(weights[0][name], each[name]) for name in each) for each in weights]
    assert same == [True, True, False]
