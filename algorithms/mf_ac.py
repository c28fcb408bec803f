"""Mean-field actor-critic (MF-AC).

Yang et al. 2018, "Mean Field Multi-Agent Reinforcement Learning", section 3 and its algorithm of the same
name: MF-Q's critic Q_i(o, a_i, m_i), m_i being the mean one-hot action of the agent's neighbours in that step
(see `algorithms.mf_q`), with a policy of its own. From replay:

    critic          Q_i(o, a_i, m_i) towards r_i + gamma * sum_a pi'_i(a | o') * Q'_i(o', a, m_i)
    policy          along the mean of grad log pi_i(a | o) * Q_i(o, a, m_i), a drawn from pi_i

Policies see their own observations only, so acting needs no other agent's action.

Deviations: as MF-Q's; the policy's gradient takes its expectation over the own action exactly, which is the
paper's gradient without the noise of sampling that action; an entropy bonus.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from gymnasium.spaces import Box
from torch import Tensor

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import ReplayBatch
from algorithms.joint.features import MEAN_ACTION, common_actions
from algorithms.joint.module import LearnerModule, critic_of
from algorithms.maac import MAACModule, of_actions
from algorithms.maddpg import ObservationNetwork
from algorithms.mf_q import MeanFieldConfig, MeanFieldLearner, mean_actions


class MeanFieldCritic(LearnerModule):
    """A group's Q(o, ., m) and its target."""

    targets = ("target_q",)

    def make_networks(self) -> None:
        """Create the critic."""
        actions = common_actions(self.spec.spaces)
        seen = {**self.group.observation, MEAN_ACTION: Box(0.0, 1.0, (actions,))}
        self.q = ObservationNetwork(replace(self.group, observation=seen), self.settings["hidden"], actions)


class MeanFieldACLearner(MeanFieldLearner):
    """Critic steps for all groups, then policy steps for all groups, then targets."""

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Take the steps of one minibatch."""
        means = mean_actions(batch, self.neighbourhood)
        self.fit_critics(batch, means)
        self.improve_policies(batch, means)
        self.polyak_update(*self.module.keys(), tau=self.config.tau)

    def fit_critics(self, batch: ReplayBatch, means: Tensor) -> None:
        """Regress Q_i(o, a_i, m_i) on r_i + gamma * E_a Q'_i(o', a, m_i), a from the target policy."""
        losses = {}
        for group, own in batch.present():
            critic, mean = self.net(critic_of(group)), {MEAN_ACTION: means[:, group.columns]}
            with torch.no_grad():
                following = critic.target_q({**own.next.observations, **mean})
                policy = self.net(group.id).distribution(own.next, target=True)
                target = self.td_target(own, (policy.log_probs.exp() * following).sum(-1))
            chosen = of_actions(critic.q({**own.observations, **mean}), own.actions)
            losses[critic_of(group)] = self.mean((chosen - target).square(), own.alive)
            self.log(group.id, "critic_loss", losses[critic_of(group)])
        self.step_each(losses)

    def improve_policies(self, batch: ReplayBatch, means: Tensor) -> None:
        """Follow the gradient of E_a Q_i(o, a, m_i), a from the own policy, m_i as replayed."""
        losses, weight = {}, self.schedule_value(self.config.entropy_coeff)
        for group, own in batch.present():
            policy = self.net(group.id).distribution(own)
            with torch.no_grad():
                seen = {**own.observations, MEAN_ACTION: means[:, group.columns]}
                values = self.net(critic_of(group)).q(seen)
            gain = self.mean((policy.log_probs.exp() * values).sum(-1), own.alive)
            entropy = self.mean(policy.entropy(), own.alive)
            losses[group.id] = -gain - weight * entropy
            self.log(group.id, "policy_loss", -gain)
            self.log(group.id, "entropy", entropy)
        self.step_each(losses)


class MeanFieldACConfig(MeanFieldConfig):
    """RLlib config of MF-AC."""

    algorithm = "mf_ac"
    policy_module, critic_module = MAACModule, MeanFieldCritic


class MeanFieldAC(JointAlgorithm):
    """MF-AC."""

    config_class = MeanFieldACConfig
    learner_class = MeanFieldACLearner
