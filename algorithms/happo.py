"""Heterogeneous-agent PPO (HAPPO): agents improve one after another, each given what the earlier ones became.

Kuba et al. 2022, "Trust Region Policy Optimisation in Multi-Agent Reinforcement Learning": in each iteration
the agents are put in a random order i_1, ..., i_n. Agent i_m takes the clipped steps of PPO on M^{i_1..i_m}
instead of the advantage A, where

    M^{i_1} = A,    M^{i_1..i_{m+1}} = M^{i_1..i_m} * pi_new(a_{i_m} | o_{i_m}) / pi_old(a_{i_m} | o_{i_m}),

so it improves on the policies that the agents before it have after their steps. No parameters are shared:
every step of a shared network would change the policies of all agents at once.

Deviations: A_i is of agent i's own reward, from MAPPO's critic with a value for each agent; the joint return
improves in every iteration (the paper's theorem 2) only where all agents get the same reward. The ratio of an
agent that is not active is 1.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from algorithms.centralised_v import CentralisedV, CentralisedVConfig, CentralisedVLearner
from algorithms.joint.batch import OnPolicyBatch
from algorithms.joint.rollout import JointRollout
from algorithms.joint.spec import Group
from algorithms.joint.stacking import StackedGroups


class HAPPOLearner(CentralisedVLearner):
    """All epochs of one agent's policy, then of the next; then those of the critic."""

    def update_joint(self, rollout: JointRollout) -> None:
        """Learn from one rollout."""
        self.update_minibatch(self.prepare(rollout))
        self.updates += 1

    def update_minibatch(self, batch: OnPolicyBatch) -> None:
        """Improve the agents in a random order on the whole rollout, then fit the critic."""
        for k in torch.randperm(len(self.groups), generator=self.generator).tolist():
            group = self.groups[k]
            for minibatch in self.minibatches(batch):
                self.step_policies(minibatch, (StackedGroups((group,), group),))
            batch = replace(batch, advantages=batch.advantages * self.ratio(group, batch))
        for minibatch in self.minibatches(batch):
            self.fit_values(minibatch)

    def ratio(self, group: Group, batch: OnPolicyBatch) -> Tensor:
        """Return (M, 1) how much more probable an agent's actions have become; 1 where it is not active."""
        own, net = batch.part(group), self.net(group.id)
        with torch.no_grad():
            new = net.head.distribution(net.policy(own), own.action_mask).log_prob(own.actions)
            return torch.where(own.alive, new - own.log_prob, 0).sum(-1, keepdim=True).exp()


class HAPPOConfig(CentralisedVConfig):
    """RLlib config of HAPPO."""

    algorithm = "happo"


class HAPPO(CentralisedV):
    """HAPPO."""

    config_class = HAPPOConfig
    learner_class = HAPPOLearner
