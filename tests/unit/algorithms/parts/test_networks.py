"""Networks of some agents only."""

import pytest
import torch
from gymnasium.spaces import Box

from algorithms.parts.networks import Encoder, outputs_where, perceptron


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_outputs_of_chosen_agents_are_those_of_all(share):
    agents = 3
    torch.manual_seed(0)
    spaces = {"a": Box(-1, 1, (4,)), "b": Box(-1, 1, (2, 3)), "c": Box(-1, 1, ())}
    encoder = Encoder(spaces, agents)
    body = perceptron([encoder.size, 8, 2])
    leaves = {name: torch.randn(20, agents, *space.shape) for name, space in spaces.items()}
    chosen = torch.rand(20, agents) < share
    every, some = body(encoder(leaves)), outputs_where(chosen, encoder, body, leaves)
    torch.testing.assert_close(some, torch.where(chosen[..., None], every, 0))
    parameters = list(body.parameters())
    wanted = torch.autograd.grad((every.square() * chosen[..., None]).sum(), parameters)
    found = torch.autograd.grad(some.square().sum(), parameters)
    for own, expected in zip(found, wanted, strict=True):
        torch.testing.assert_close(own, expected, rtol=1e-4, atol=1e-5)
