"""Agents that share a network without their place in it are interchangeable."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rigs import Rig, cases, takes

import algorithms
from algorithms.parts.distributions import Exploration
from tests.games.games import Ragged

IN_ORDER = {"bicnet", "mat", "opponent_q", "pr2", "qdpp", "rommeo"}
"""Algorithms whose policies know the others by their number, or act in the order of the agents."""
TURN = [2, 0, 1]


EQUAL = [name for name in algorithms.names() if takes(name, sharing="all", identity=False)]


@pytest.mark.parametrize("name", cases([name for name in EQUAL if name not in IN_ORDER]))
def test_permuting_the_agents_permutes_what_they_do_unless_they_have_an_identity(name):
    for identity in (identity for identity in (False, True) if takes(name, identity=identity)):
        rig = Rig(name, Ragged, sharing="all", identity=identity)
        generator = torch.Generator().manual_seed(0)
        with torch.no_grad():
            for parameter in rig.learner.net("shared").parameters():
                parameter.copy_(torch.randn(parameter.shape, generator=generator))
        rig.policies.refresh()
        view = rig.rollout(32, epsilon=1.0).views[:32, 0]
        rng = np.random.default_rng(0)
        seen = {
            key: rng.standard_normal(leaf.shape, np.float32) for key, leaf in view.observations[0].items()
        }
        moved = {key: leaf[:, TURN].copy() for key, leaf in seen.items()}
        first, second = (
            rig.policies.act(each, Exploration(explore=False), torch.Generator())[0].actions
            for each in (
                replace(view, observations=(seen,)),
                replace(view, observations=(moved,), alive=view.alive[:, TURN].copy()),
            )
        )
        assert torch.equal(first[:, TURN], second) != identity
