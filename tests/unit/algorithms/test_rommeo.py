"""ROMMEO: its closed form against enumeration and other policies, and games of hope and experience."""

from itertools import product

import pytest
import torch
from rigs import Rig
from test_opponents import check_temporal_difference, climbing_score, hills_score, turncoat_score

from algorithms.joint.batch import GroupView
from tests.games.games import Ragged

ALPHA = 0.3


def situation(seed=0):
    """Return an agent's network and view, and by enumeration Q (3, 16) and log P (16,).

    The columns are what the two others do together: three actions or absence each.
    """
    torch.manual_seed(seed)
    rig = Rig("rommeo", Ragged, alpha=ALPHA, seed=seed)
    rig.learner.update_joint(rig.rollout(64, epsilon=1.0))
    net = rig.learner.net("a")
    view = GroupView({"": torch.randn(1, 1, 3)}, torch.ones(1, 1, dtype=torch.bool), None)
    with torch.no_grad():
        own, pairs = net.q(view.observations)
        model = net.model(view.observations)[0, 0]
    values, chances = torch.zeros(3, 16), torch.zeros(16)
    for k, (b, c) in enumerate(product(range(4), repeat=2)):
        values[:, k] = own[0, 0]
        values[:, k] += pairs[0, 0, :, 1, b] if b < 3 else 0
        values[:, k] += pairs[0, 0, :, 2, c] if c < 3 else 0
        chances[k] = model[1, b] + model[2, c]
    return rig, net, view, values, chances


def best_pair(values, chances):
    """Return pi (3, 16), rho (16,) and V of the paper's eq. 9 to 11, for rewards divided by ALPHA."""
    total = (values / ALPHA).logsumexp(0)
    value = ALPHA * (chances + total).logsumexp(0)
    return (values / ALPHA - total).exp(), (chances + total - value / ALPHA).exp(), value


def objective(pi, rho, values, chances):
    """Return E Q + alpha H(pi) - alpha KL(rho || P), written out."""
    both = pi * rho
    entropy = -(both * pi.log()).sum()
    divergence = (rho * (rho.log() - chances)).sum()
    return (both * values).sum() + ALPHA * entropy - ALPHA * divergence


@pytest.mark.parametrize("seed", [0, 1])
def test_no_policy_and_model_reach_more_than_the_closed_form(seed):
    *_, values, chances = situation(seed)
    pi, rho, value = best_pair(values, chances)
    torch.testing.assert_close(pi.sum(0), torch.ones(16))
    torch.testing.assert_close(rho.sum(), torch.tensor(1.0))
    torch.testing.assert_close(objective(pi, rho, values, chances), value)
    for _ in range(200):
        other = (pi.log() + 0.3 * torch.randn(3, 16)).softmax(0)
        model = (rho.log() + 0.3 * torch.randn(16)).softmax(0)
        assert objective(other, rho, values, chances) < value
        assert objective(pi, model, values, chances) < value


@pytest.mark.parametrize("seed", [0, 1])
def test_agents_draw_from_the_mean_of_the_policy_under_the_model(seed):
    """And bootstrap from V: both by enumeration of what two others do together."""
    rig, net, view, values, chances = situation(seed)
    pi, rho, value = best_pair(values, chances)
    with torch.no_grad():
        policy = net.policy(view)[0, 0].softmax(-1)
        net.target_q.load_state_dict(net.q.state_dict())
        found = rig.learner.next_value(net, view)
    torch.testing.assert_close(policy, (pi * rho).sum(1), rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(found[0, 0], value, rtol=1e-4, atol=1e-5)


def test_with_a_large_weight_it_expects_what_it_saw():
    """The opponent model is then P, and q(a_i) what `opponent_q` expects; with a small one it hopes."""
    _, net, view, values, chances = situation()
    own = values @ chances.exp()
    with torch.no_grad():
        net.settings = {**net.settings, "alpha": 1e3}
        torch.testing.assert_close(net.values(view, net.q)[0, 0], own, rtol=0, atol=2e-3)
        net.settings = {**net.settings, "alpha": 1e-4}
        assert torch.allclose(net.values(view, net.q)[0, 0], values.amax(1), atol=2e-3)


def test_the_temporal_difference_is_soft():
    rig = Rig("rommeo", Ragged, gamma=0.9, reward_scale=0.5, alpha=ALPHA)
    check_temporal_difference(rig, lambda values: ALPHA * (values / ALPHA).exp().sum(-1).log())


@pytest.mark.nightly
def test_agents_that_hope_climb_and_find_the_narrow_hill():
    """11 of 11, and 1 of 1; `opponent_q`, which only expects, does not climb (`test_opponents.py`)."""
    assert (climbing_score("rommeo", 1) > 9).all()
    assert (hills_score("rommeo", 1) > 0.8).all()


@pytest.mark.nightly
def test_experience_keeps_hope_in_bounds():
    """A leader that answers nobody is followed."""
    assert turncoat_score("rommeo", 1) > (0.85 + 0.05) / 2
