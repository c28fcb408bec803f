"""Actor-critic with a centralised state-value function: multi-agent PPO (MAPPO).

Yu et al. 2022, "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games": policies see their own
observations and take the clipped steps of PPO (eq. 7 of Schulman et al. 2017); one critic V(s) sees the
global state and exists in training only. Foerster et al. 2018 call the same critic "central-V".

Deviations: the critic gives each agent its own value V_i(s), since rewards are individual here; the state is
the environment's, or all observations side by side with which agents are active; the value loss is not
clipped.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from algorithms.joint.batch import JointView, OnPolicyBatch
from algorithms.joint.env import MEMORY
from algorithms.joint.joint_encoder import JointEncoder
from algorithms.joint.module import LearnerModule
from algorithms.parts.moments import RunningMoments
from algorithms.parts.networks import orthogonal, perceptron
from algorithms.ppo import PPO, PPOConfig, PPOLearner

CRITIC = "central__critic"


class CentralValue(LearnerModule):
    """V_1(s), ..., V_N(s) from the global state."""

    joins = "state"

    def make_networks(self) -> None:
        """Create the body."""
        # The environment's state knows nothing of memories; joined observations hold them already.
        self._beside = self.spec.spaces.state > 0 and MEMORY in self.spec.spaces.blocks[0].observation
        self.encoder = JointEncoder(self.spec)
        width = self.encoder.size
        if self._beside:
            width += len(self.spec.agents) * self.spec.spaces.blocks[0].observation[MEMORY].shape[0]
        sizes = [width, *self.settings["hidden"], len(self.spec.agents)]
        self.body = orthogonal(perceptron(sizes), gain=np.sqrt(2), last=1)
        self.moments = RunningMoments(enabled=self.settings["normalize_values"])

    def value(self, view: JointView) -> Tensor:
        """Return scaled values (M, N)."""
        state = self.encoder(view)
        if self._beside:
            state = torch.cat([state, *(leaves[MEMORY].flatten(-2) for leaves in view.observations)], -1)
        return self.body(state)


class CentralisedVLearner(PPOLearner):
    """PPO's policy steps on advantages of a central critic."""

    def values(self, view: JointView) -> Tensor:
        """Return each agent's value of the global state, (M, N)."""
        critic = self.net(CRITIC)
        return critic.moments.unscaled(critic.value(view))

    def observe_targets(self, batch: OnPolicyBatch) -> None:
        """Adapt the scale of the critic."""
        self.net(CRITIC).moments.observe(batch.targets, batch.alive)

    def fit_values(self, batch: OnPolicyBatch) -> None:
        """Regress all agents' values at once."""
        critic = self.net(CRITIC)
        error = (critic.value(batch) - critic.moments.scaled(batch.targets)).square()
        loss = self.mean(error, batch.alive)
        if len(batch.absent) < len(self.groups):
            self.step_optimizer(loss, CRITIC)
        self.log(CRITIC, "value_loss", loss)


class CentralisedVConfig(PPOConfig):
    """RLlib config of MAPPO."""

    algorithm = "centralised_v"
    critic_module = None
    team_modules: ClassVar = {CRITIC: CentralValue}


class CentralisedV(PPO):
    """MAPPO."""

    config_class = CentralisedVConfig
    learner_class = CentralisedVLearner
