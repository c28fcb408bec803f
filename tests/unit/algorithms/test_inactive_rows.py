"""Rows of inactive agents have no gradient, whatever their densities are."""

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from rigs import Rig

from tests.games.games import Ragged


class Wide(Ragged):
    """Agents that come and go, with thirty continuous actions."""

    crash = 0.0

    def __init__(self, config=None):
        super().__init__(config)
        self.action_spaces = {a: Box(-1.0, 1.0, (30,), np.float32) for a in self.agents}


@pytest.mark.parametrize("sharing", ["none", "all"])
def test_densities_that_overflow_in_inactive_rows_leave_weights_finite(sharing):
    """The density of thirty narrow actions is exp(122), beyond float32; inactive rows store 0 for its log."""
    rig = Rig("ppo", Wide, sharing=sharing)
    for group in rig.spec.groups:
        last = rig.learner.net(group.id).feedforward_parts()[1][-1]
        with torch.no_grad():
            last.weight.zero_()
            last.bias.zero_()
            last.bias[30:] = -5.0
    rollout = rig.rollout(16)
    assert not rollout.views.alive[:-1].all()
    rig.learner.update_joint(rollout)
    assert all(torch.isfinite(w).all() for own in rig.weights().values() for w in own.values())
