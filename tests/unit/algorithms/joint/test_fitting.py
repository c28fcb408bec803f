"""Weights for another number of agents that share a network."""

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from torch import nn

from algorithms.joint.fitting import Agents, fitted_weights
from algorithms.parts.networks import Encoder, perceptron

SEEN = {"": Box(-1, 1, (3,), np.float32)}


def network(agents):
    encoder = Encoder(SEEN, agents)
    return nn.ModuleDict({"encoder": encoder, "body": perceptron([encoder.size, 5, 2])})


def weights_of(net):
    return {name: array.numpy() for name, array in net.state_dict().items()}


def outputs(net, seen):
    """Return the outputs of each agent, (n, 2), all of which see the same."""
    agents = max(net["encoder"].places, 1)
    with torch.no_grad():
        return net["body"](net["encoder"]({"": seen.expand(1, agents, 3)}))[0]


@pytest.mark.parametrize(("there", "here"), [(4, 2), (4, 1), (2, 5), (1, 3), (3, 3)])
def test_each_agent_acts_as_the_one_in_its_place(there, here):
    trained, fresh, seen = network(there), network(here), torch.randn(3)
    weights, unfit = fitted_weights(
        weights_of(fresh), weights_of(trained), Agents(here, here), Agents(there, there)
    )
    assert unfit == []
    fresh.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
    expected = outputs(trained, seen)[np.arange(here) % there]
    torch.testing.assert_close(outputs(fresh, seen), expected)


def test_the_number_of_an_agent_among_its_inputs_is_of_so_many_agents():
    """Inputs: one number, three of the agent's, one more; then two places."""
    given = {"weight": np.array([[9, 10, 11, 12, 8, 1, 2]])}
    own = {"weight": np.zeros((1, 10))}
    weights, unfit = fitted_weights(own, given, Agents(5, 3), Agents(3, 2), index=1)
    assert unfit == []
    assert weights["weight"].tolist() == [[9, 10, 11, 12, 10, 11, 8, 1, 2, 1]]


def test_what_does_not_fit_stays_and_is_named():
    own, given = ({"a": np.full(2, x), "b": np.full((2, width), x)} for x, width in ((0.0, 3), (1.0, 4)))
    weights, unfit = fitted_weights({**own, "c": np.zeros(1)}, given, Agents(2, 2), Agents(2, 2))
    assert unfit == ["b", "c"]
    assert (weights["a"] == 1).all()
    assert (weights["b"] == 0).all()
