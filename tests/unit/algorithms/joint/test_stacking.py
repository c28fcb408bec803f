"""Networks that are evaluated for active agents alone."""

import pytest
import torch

from algorithms.joint.stacking import outputs_where
from algorithms.parts.networks import perceptron


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_outputs_and_gradients_are_those_of_active_agents(share):
    generator = torch.Generator().manual_seed(1)
    network, features = perceptron([5, 8, 3]), torch.randn(20, 4, 5, generator=generator)
    alive = torch.rand(20, 4, generator=generator) < share
    whole, found = network(features), outputs_where(alive, features, network)
    assert found.shape == whole.shape
    torch.testing.assert_close(found, torch.where(alive[..., None], whole, 0))
    parameters = [*network.parameters()]
    wanted = torch.autograd.grad(torch.where(alive[..., None], whole, 0).square().sum(), parameters)
    for one, other in zip(torch.autograd.grad(found.square().sum(), parameters), wanted, strict=True):
        torch.testing.assert_close(one, other)


def test_what_inactive_agents_see_does_not_matter():
    network, alive = perceptron([2, 4, 1]), torch.tensor([[True, False]])
    features = torch.tensor([[[1.0, 2.0], [torch.nan, torch.inf]]])
    outputs = outputs_where(alive, features, network)
    gradients = torch.autograd.grad(outputs.sum(), [*network.parameters()])
    assert all(each.isfinite().all() for each in (outputs, *gradients))
