import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from torch.distributions import Categorical, Normal

from algorithms.parts.distributions import (
    CategoricalDistribution,
    DeterministicHead,
    EpsilonGreedyHead,
    Exploration,
    GaussianDistribution,
)
from algorithms.parts.networks import Encoder
from algorithms.parts.relaxation import straight_through_gumbel


def test_categorical_agrees_with_torch():
    logits = torch.randn(7, 3, 5)
    ours, theirs = CategoricalDistribution(logits), Categorical(logits=logits)
    actions = theirs.sample()
    torch.testing.assert_close(ours.log_prob(actions), theirs.log_prob(actions))
    torch.testing.assert_close(ours.entropy(), theirs.entropy())


def test_samples_come_at_their_probabilities():
    logits = torch.tensor([0.0, 1.0, 2.0]).expand(200_000, 3)
    drawn = CategoricalDistribution(logits).sample(torch.Generator().manual_seed(0))
    torch.testing.assert_close(drawn.bincount() / 200_000, logits[0].softmax(-1), atol=5e-3, rtol=0)


def test_gaussian_agrees_with_torch():
    mean, log_std, actions = torch.randn(4, 2), torch.randn(4, 2).tanh(), torch.randn(4, 2)
    ours, theirs = GaussianDistribution(mean, log_std), Normal(mean, log_std.exp())
    torch.testing.assert_close(ours.log_prob(actions), theirs.log_prob(actions).sum(-1))
    torch.testing.assert_close(ours.entropy(), theirs.entropy().sum(-1))


def test_epsilon_is_spread_over_the_legal_actions():
    values = torch.tensor([5.0, 1.0, 2.0]).expand(100_000, 1, 3)
    action_mask = torch.tensor([False, True, True]).expand_as(values)
    generator = torch.Generator().manual_seed(0)
    acting = EpsilonGreedyHead(Discrete(3)).act(values, action_mask, Exploration(epsilon=0.4), generator)
    torch.testing.assert_close(acting.distribution[0, 0], torch.tensor([0.0, 0.2, 0.8]))
    shares = acting.actions.flatten().bincount(minlength=3) / 100_000
    torch.testing.assert_close(shares, torch.tensor([0.0, 0.2, 0.8]), atol=1e-2, rtol=0)


def test_noise_stays_within_bounds_and_greedy_play_has_none():
    head, outputs = DeterministicHead(Box(0, 1, (2,), np.float32)), torch.full((1000, 1, 2), 3.0)
    noisy = head.act(outputs, None, Exploration(noise=1.0), torch.Generator().manual_seed(0)).actions
    assert noisy.abs().max() <= 1
    greedy = head.act(outputs, None, Exploration(explore=False, noise=1.0), torch.Generator()).actions
    assert torch.equal(greedy, outputs.tanh())


def test_gumbel_samples_are_one_hot_legal_and_carry_gradients():
    logits = torch.zeros(100, 4, requires_grad=True)
    action_mask = torch.tensor([True, False, True, True]).expand(100, 4)
    sample = straight_through_gumbel(logits, action_mask, torch.Generator().manual_seed(0))
    assert torch.equal(sample.detach().sum(-1), torch.ones(100))
    assert (sample.detach()[:, 1] == 0).all()
    (sample * torch.randn(4)).sum().backward()
    assert logits.grad is not None
    assert (logits.grad[:, [0, 2, 3]] != 0).any()
    assert (logits.grad[:, 1] == 0).all()


def test_images_of_either_order_and_identities_are_encoded():
    space = {"image": Box(0, 255, (16, 16, 3), np.uint8), "map": Box(0.0, 1.0, (1, 32, 32), np.float32)}
    encoder = Encoder({**space, "speed": Box(0.0, 1.0, (), np.float32)}, agents=2)
    leaves = {
        "image": torch.zeros(5, 2, 16, 16, 3, dtype=torch.uint8),
        "map": torch.zeros(5, 2, 1, 32, 32),
        "speed": torch.zeros(5, 2),
    }
    features = encoder(leaves)
    assert features.shape == (5, 2, encoder.size)
    assert (features[:, 0] != features[:, 1]).any()
