import numpy as np
import pytest
import torch

from algorithms.parts.graph import complete, consensus_rate, metropolis, ring, within


@pytest.mark.parametrize("seed", range(2))
def test_metropolis_weights_are_doubly_stochastic_and_respect_the_graph(seed):
    rng = np.random.default_rng(seed)
    upper = np.triu(rng.random((6, 6)) < 0.4, 1)
    links = torch.tensor(upper | upper.T)
    weights = metropolis(links)
    torch.testing.assert_close(weights.sum(0), torch.ones(6))
    torch.testing.assert_close(weights.sum(1), torch.ones(6))
    assert (weights >= 0).all()
    off_diagonal = ~torch.eye(6, dtype=torch.bool)
    assert torch.equal((weights > 0) & off_diagonal, links)


def test_one_exchange_on_a_complete_graph_is_the_mean():
    torch.testing.assert_close(metropolis(complete(5)), torch.full((5, 5), 0.2))
    assert consensus_rate(metropolis(complete(5))) == pytest.approx(0, abs=1e-6)


def test_a_ring_of_four_agrees_at_a_rate_of_a_third_with_self_loops_and_never_without():
    assert consensus_rate(metropolis(ring(4))) == pytest.approx(1 / 3)
    selfless = ring(4) / 2
    assert consensus_rate(selfless) == pytest.approx(1)
    start = torch.tensor([1.0, 0.0, 0.0, 0.0])
    torch.testing.assert_close(
        torch.linalg.matrix_power(metropolis(ring(4)), 30) @ start, torch.full((4,), 0.25)
    )
    assert (torch.linalg.matrix_power(selfless, 30) @ start).max() == 0.5


def test_rings_of_one_and_two_have_no_double_links():
    assert not ring(1).any()
    assert torch.equal(ring(2), complete(2))


def test_distance_counts_up_to_the_radius_and_never_oneself():
    positions = torch.tensor([[0.0, 0.0], [3.0, 4.0], [3.0, 4.5]])
    expected = torch.tensor([[0, 1, 0], [1, 0, 1], [0, 1, 0]], dtype=torch.bool)
    assert torch.equal(within(positions, 5.0), expected)
