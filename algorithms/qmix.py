"""QMIX: the team's value is a monotone function of the agents' values, whose weights depend on the state.

Rashid et al. 2018, "QMIX: Monotonic Value Function Factorisation for Deep Multi-Agent Reinforcement
Learning", eq. 5: dQ_tot/dQ_i >= 0 by absolute weights from hypernetworks of the global state; loss of eq. 6.

Deviations: as VDN; the state is the environment's, or all agents' encoded observations with which agents are
active; the hypernetworks read it standardised over its numbers (layer normalisation without weights).
"""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from algorithms.joint.batch import JointView
from algorithms.joint.joint_encoder import JointEncoder
from algorithms.joint.module import LearnerModule
from algorithms.parts.networks import perceptron
from algorithms.vdn import VDN, VDNConfig, VDNLearner

MIXER = "team__mixer"


class MonotoneMixer(nn.Module):
    """Q_tot(s, Q_1, ..., Q_N) with one hidden layer of `width` units, s as the encoder returns it."""

    def __init__(self, encoder: JointEncoder, agents: int, width: int) -> None:
        super().__init__()
        self._shape = agents, width
        self.encoder, state = encoder, encoder.size
        # Weights far above the usual, of agents that have strayed far, would make values diverge.
        self.normal = nn.LayerNorm(state, elementwise_affine=False) if state > 1 else nn.Identity()
        self.first_weight = perceptron([state, 64, agents * width], nn.ReLU)
        self.first_bias = nn.Linear(state, width)
        self.last_weight = perceptron([state, 64, width], nn.ReLU)
        self.last_bias = perceptron([state, width, 1], nn.ReLU)

    def forward(self, values: Tensor, view: JointView) -> Tensor:
        """Return the team's values (M,) of the agents' (M, N)."""
        state = self.normal(self.encoder(view))
        weight = self.first_weight(state).abs().unflatten(-1, self._shape)
        hidden = nn.functional.elu(torch.einsum("mn,mnw->mw", values, weight) + self.first_bias(state))
        return (hidden * self.last_weight(state).abs()).sum(-1) + self.last_bias(state).squeeze(-1)


class QMIXMixer(LearnerModule):
    """The mixer and its target."""

    targets, joins = ("target_mixer",), "state"

    def make_encoder(self) -> JointEncoder:
        """Return what encodes the state that the weights depend on."""
        return JointEncoder(self.spec)

    def make_networks(self) -> None:
        """Create the mixer."""
        sizes = len(self.spec.agents), self.settings["mixer_width"]
        self.mixer = MonotoneMixer(self.make_encoder(), *sizes)


class QMIXLearner(VDNLearner):
    """VDN's step with a learned mixer."""

    def mix(self, values: Tensor, view: JointView, *, target: bool = False) -> Tensor:
        """Return the team's values (M,)."""
        net = self.net(MIXER)
        return (net.target_mixer if target else net.mixer)(values, view)

    def trained(self) -> tuple[str, ...]:
        """Return the networks that the team's loss steps."""
        return (*super().trained(), MIXER)


class QMIXConfig(VDNConfig):
    """RLlib config of QMIX."""

    algorithm = "qmix"
    team_modules: ClassVar = {MIXER: QMIXMixer}
    network_settings = (*VDNConfig.network_settings, "mixer_width")


class QMIX(VDN):
    """QMIX."""

    config_class = QMIXConfig
    learner_class = QMIXLearner
