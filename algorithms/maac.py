"""Multi-actor-attention-critic (MAAC): a soft actor-critic with an attentive critic.

Iqbal & Sha 2019, "Actor-Attention-Critic for Multi-Agent Reinforcement Learning". Each agent's Q_i(o, a) is a
function of its own embedding and of a sum over the other agents' values V g_j(o_j, a_j), weighted by
attention (section 3.2). One critic of all agents is fitted by their joint loss with all agents' target
policies. Policies follow the soft policy gradient with all agents' actions drawn from the present policies,
and with the counterfactual baseline sum_a pi_i(a | o_i) Q_i(o, (a, a_-i)). So that one pass gives Q_i for all
own actions (section 3.3), neither query nor own embedding contains the agent's own action.

Deviations: losses are means over the active agents instead of sums over all (the authors' code scales the
critic's gradient by 1/N too); attention skips agents that are not there; no batch normalisation of
observations and no penalty on logits, which are in the authors' code only; embeddings have one hidden layer
of the width `hidden[-1]`; agents of a group share networks and are told apart by their place.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import ClassVar, cast

import torch
from torch import Tensor, nn

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, JointView, ReplayBatch, encode
from algorithms.joint.config import JointConfig
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import LearnerModule
from algorithms.joint.spec import Group, JointSpec, action_size
from algorithms.maddpg import ActorModule
from algorithms.parts.attention import attend
from algorithms.parts.distributions import CategoricalDistribution
from algorithms.parts.networks import Encoder, perceptron

CRITIC = "attention__critic"


class MAACModule(ActorModule):
    """A policy and its target, which actions are drawn from."""

    def distribution(self, view: GroupView, *, target: bool = False) -> CategoricalDistribution:
        """Return the policy or the target policy."""
        actor = self.target_actor if target else self.actor
        return CategoricalDistribution(actor.of_active(view), view.action_mask)


class AgentEmbedding(nn.Module):
    """The parts of the attention critic that belong to a group: s_i(o_i), g_i(o_i, a_i), and f_i."""

    def __init__(self, group: Group, width: int) -> None:
        super().__init__()
        actions = action_size(group.action)
        self.see = Encoder(group.observation, group.places, group.set_width)
        self.own = nn.Sequential(nn.Linear(self.see.size, width), nn.LeakyReLU())
        self.see_pair = Encoder(group.observation, group.places, group.set_width)
        self.pair = nn.Sequential(nn.Linear(self.see_pair.size + actions, width), nn.LeakyReLU())
        self.judge = perceptron([2 * width, width, actions], nn.LeakyReLU)

    def embed(self, leaves: Mapping[str, Tensor], actions: Tensor) -> tuple[Tensor, Tensor]:
        """Return embeddings (M, n, H) of observations, and of observations with actions."""
        pair = torch.cat([self.see_pair(leaves), actions], -1)
        return self.own(self.see(leaves)), self.pair(pair)


class AttentionQ(nn.Module):
    """Q_i(o, (., a_-i)) for all agents and all own actions, shape (M, n, A) by group id."""

    def __init__(self, spec: JointSpec, width: int, heads: int) -> None:
        super().__init__()
        self._groups, self._heads = spec.groups, (heads, width // heads)
        self.embeddings = nn.ModuleList(AgentEmbedding(group, width) for group in spec.groups)
        self.query = nn.Linear(width, width, bias=False)
        self.key = nn.Linear(width, width, bias=False)
        self.value = nn.Sequential(nn.Linear(width, width), nn.LeakyReLU())

    def forward(self, view: JointView, actions: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the values.

        Args:
            view: What all agents see.
            actions: All agents' actions by group id, one-hot (M, n, A).
        """
        embeddings = cast(Iterable[AgentEmbedding], self.embeddings)
        parts, absent = [view.view(group) for group in self._groups], view.absent
        embedded = [
            [
                without_gradient_if(group.id in absent, x)
                for x in net.embed(part.observations, actions[group.id])
            ]
            for net, part, group in zip(embeddings, parts, self._groups, strict=True)
        ]
        own, pairs = (torch.cat(column, -2) for column in zip(*embedded, strict=True))
        alive = torch.cat([part.alive for part in parts], -1)
        asked, found, given = (
            x.unflatten(-1, self._heads) for x in (self.query(own), self.key(pairs), self.value(pairs))
        )
        both = torch.cat([own, attend(asked, found, given, alive).flatten(-2)], -1)
        shares = both.split([group.size for group in self._groups], -2)
        return {
            group.id: without_gradient_if(group.id in absent, net.judge(share))
            for net, share, group in zip(embeddings, shares, self._groups, strict=True)
        }


def without_gradient_if(condition: bool, x: Tensor) -> Tensor:
    """Detach `x` if the condition holds, so that its module is not stepped, not even by Adam's momentum."""
    return x.detach() if condition else x


class MAACCritic(LearnerModule):
    """The critic of all agents and its target."""

    targets = ("target_q",)

    def make_networks(self) -> None:
        """Create the critic."""
        self.q = AttentionQ(self.spec, self.settings["hidden"][-1], self.settings["attention_heads"])


def of_actions(values: Tensor, actions: Tensor) -> Tensor:
    """Return (...) the values (..., A) of the actions (...)."""
    return values.gather(-1, actions.unsqueeze(-1)).squeeze(-1)


def counterfactual_advantage(values: Tensor, policy: CategoricalDistribution, actions: Tensor) -> Tensor:
    """Return Q_i(o, a) minus its expectation under the own policy, (M, n)."""
    baseline = (policy.log_probs.exp() * values).sum(-1)
    return of_actions(values, actions) - baseline


class MAACLearner(OffPolicyLearner):
    """A step of the critic, then of every policy, then targets."""

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Take the steps of one minibatch."""
        self.fit_critic(batch)
        self.improve_policies(batch)
        self.polyak_update(*self.module.keys(), tau=self.config.tau)

    def play(
        self, view: JointView, *, target: bool = False
    ) -> tuple[dict[str, CategoricalDistribution], dict[str, Tensor], dict[str, Tensor]]:
        """Return all agents' policies, actions (M, n) drawn from them, and these one-hot, by group id."""
        policies, actions, encoded = {}, {}, {}
        for group in self.groups:
            policies[group.id] = self.net(group.id).distribution(view.view(group), target=target)
            actions[group.id] = policies[group.id].sample(self.generator)
            encoded[group.id] = encode(group, actions[group.id])
        return policies, actions, encoded

    def fit_critic(self, batch: ReplayBatch) -> None:
        """Regress Q_i(o, a) on r_i + gamma (Q'_i(o', a') - alpha log pi'_i(a'_i)), a' ~ pi'."""
        with torch.no_grad():
            policies, chosen, encoded = self.play(batch.next, target=True)
            following = self.net(CRITIC).target_q(batch.next, encoded)
        values, errors = self.net(CRITIC).q(batch, batch.encoded_actions()), {}
        for group, own in batch.groups():
            actions = chosen[group.id]
            value = of_actions(following[group.id], actions)
            soft = value - self.config.alpha * policies[group.id].log_prob(actions)
            error = of_actions(values[group.id], own.actions) - self.td_target(own, soft)
            errors[group.id] = error.square()
        loss = self.mean(batch.join(errors), batch.alive)
        self.step_optimizer(loss, CRITIC)
        self.log(CRITIC, "critic_loss", loss)

    def improve_policies(self, batch: ReplayBatch) -> None:
        """Follow grad log pi_i(a_i) (A_i(o, a) - alpha log pi_i(a_i)), a ~ pi."""
        policies, chosen, encoded = self.play(batch)
        with torch.no_grad():
            values = self.net(CRITIC).q(batch, encoded)
        losses = {}
        for group, own in batch.present():
            policy, actions = policies[group.id], chosen[group.id]
            log_prob = policy.log_prob(actions)
            advantage = counterfactual_advantage(values[group.id], policy, actions)
            gain = (advantage - self.config.alpha * log_prob).detach()
            losses[group.id] = -self.mean(log_prob * gain, own.alive)
            self.log(group.id, "policy_loss", losses[group.id])
            self.log(group.id, "entropy", self.mean(policy.entropy(), own.alive))
        self.step_each(losses)


class MAACConfig(JointConfig):
    """RLlib config of MAAC."""

    algorithm = "maac"
    policy_module = MAACModule
    team_modules: ClassVar = {CRITIC: MAACCritic}
    network_settings = ("attention_heads",)


class MAAC(JointAlgorithm):
    """MAAC."""

    config_class = MAACConfig
    learner_class = MAACLearner
