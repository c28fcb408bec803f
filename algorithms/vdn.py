"""Value decomposition networks (VDN): the team's value is the sum of the agents' values.

Sunehag et al. 2018, "Value-Decomposition Networks for Cooperative Multi-Agent Learning", eq. 3: Q_tot = sum_i
Q_i(o_i, a_i), learned end to end from the team's reward by the squared double-Q temporal difference.

Deviations: recurrence is optional (`gru`); absent agents contribute zero, and the team's reward is the sum
(or mean) over those present, standardised if asked for (`standardize_rewards`).
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from algorithms.dqn import DQN, DQNConfig, DQNLearner
from algorithms.joint.batch import JointView, ReplayBatch
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.replay import JointReplay
from algorithms.joint.team import TeamLearner


class VDNLearner(TeamLearner, DQNLearner):
    """One temporal difference for the whole team. Others override `mix`, `penalty` and `trained`."""

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Step all networks together towards the team's target."""
        following = batch.next
        values, chosen, best = {}, {}, {}
        for group, own in batch.groups():
            net = self.net(group.id)
            values[group.id] = net.policy(own)
            chosen[group.id] = values[group.id].gather(-1, own.actions.unsqueeze(-1)).squeeze(-1)
            best[group.id] = self.next_value(net, *self.following(net, own))
        total = self.mix(torch.where(batch.alive, batch.join(chosen), 0), batch)
        with torch.no_grad():
            # All agents that are active next count, late arrivals too, as when that moment is fitted.
            value = self.mix(torch.where(following.alive, batch.join(best), 0), following, target=True)
            value = torch.where(following.alive.any(-1), value, 0)
            target = self.reward(batch) + self.gamma * value
        # Squared, not Huber's: a sum fits most games only on average, and it is the mean that is meant.
        loss = self.mean((total - target).square(), batch.alive.any(-1))
        total_loss = loss + self.penalty(batch, values)
        self.step_optimizer(total_loss, *(name for name in self.trained() if name not in batch.absent))
        self.log(self.groups[0].id, "td_loss", loss)
        self.polyak_update(*self.trained(), tau=self.config.tau)

    def make_replay(self) -> JointReplay:
        """Return an empty replay buffer: the team's loss gives no agent's difference to rank by."""
        return OffPolicyLearner.make_replay(self)

    def mix(self, values: Tensor, view: JointView, *, target: bool = False) -> Tensor:
        """Return the team's values (M,) of the agents' (M, N), zeros for the absent."""
        return values.sum(-1)

    def penalty(self, batch: ReplayBatch, values: Mapping[str, Tensor]) -> Tensor | float:
        """Return what is added to the loss, given the agents' values (M, n, A) by group id."""
        return 0.0

    def trained(self) -> tuple[str, ...]:
        """Return the networks that the team's loss steps."""
        return tuple(group.id for group in self.groups)


class VDNConfig(DQNConfig):
    """RLlib config of VDN."""

    algorithm = "vdn"


class VDN(DQN):
    """VDN."""

    config_class = VDNConfig
    learner_class = VDNLearner
