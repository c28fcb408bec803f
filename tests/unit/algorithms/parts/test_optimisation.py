"""Several networks at once become, bit by bit, what each becomes alone."""

import pytest
import torch
from torch import nn

from algorithms.parts.optimisation import follow, step_together


def networks():
    """Return three networks, of which one has a parameter that no loss reaches, and one no gradient."""
    torch.manual_seed(0)
    made = [nn.Sequential(nn.Linear(3, 5), nn.Linear(5, 2)), nn.Linear(3, 2), nn.Linear(3, 2)]
    made[0].register_parameter("unused", nn.Parameter(torch.ones(4)))
    return made


def give_gradients(nets, scale):
    for net in nets[:2]:
        for name, p in net.named_parameters():
            p.grad = None if name == "unused" else scale * torch.randn(p.shape)


def adams(nets, rates):
    return [
        torch.optim.Adam(net.parameters(), lr=lr, eps=1e-5, fused=True)
        for net, lr in zip(nets, rates, strict=True)
    ]


@pytest.mark.parametrize("rates", [(0.01, 0.01, 0.01), (0.01, 0.003, 0.01)])
def test_adams_that_step_together_step_as_alone(rates):
    together, alone = networks(), networks()
    both = adams(together, rates), adams(alone, rates)
    for _ in range(4):
        give_gradients(together, 1.0)
        for net, other in zip(together, alone, strict=True):
            for p, q in zip(net.parameters(), other.parameters(), strict=True):
                q.grad = None if p.grad is None else p.grad.clone()
        step_together(both[0])
        for optimizer in both[1]:
            optimizer.step()
        for net, other in zip(together, alone, strict=True):
            assert all(map(torch.equal, net.parameters(), other.parameters()))
    states = [optimizer.state_dict() for optimizer in both[0]]
    for state, optimizer in zip(states, both[1], strict=True):
        assert str(state) == str(optimizer.state_dict())


def test_targets_follow():
    own, followed = torch.tensor([0.0, 4.0]), torch.tensor([8.0, 0.0])
    follow([(own, followed)], 0.25)
    assert own.tolist() == [2.0, 3.0]
    follow([], 0.25)
