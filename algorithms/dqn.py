"""Independent deep Q-learning, double and duelling.

Every group of agents fits Q(o_i, a_i) as if the others were part of its environment (Tampuu et al. 2017).
Mnih et al. 2015, "Human-level control through deep reinforcement learning": replay and target network, eq. 1
with the Huber loss; van Hasselt et al. 2016: the online network chooses the next action and the target
network values it; Wang et al. 2016, eq. 9: duelling value and advantage streams.

Optional: prioritised replay (Schaul et al. 2016), with priorities of joint transitions by the mean over
active agents; recurrent networks (Hausknecht & Stone 2015) that replay sequences from their stored memory
(Kapturowski et al. 2019, without burn-in).

Deviations: target networks follow by polyak averaging instead of periodic copies; beta is constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor, nn

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, ReplayBatch, ReplayGroup
from algorithms.joint.config import JointConfig
from algorithms.joint.env import MEMORY
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import JointModule, encoder_of
from algorithms.joint.prioritised import PrioritisedReplay
from algorithms.joint.replay import JointReplay
from algorithms.joint.spec import Group
from algorithms.parts.distributions import EpsilonGreedyHead, Head
from algorithms.parts.masking import MASKED_LOGIT
from algorithms.parts.memory import GRUMemory
from algorithms.parts.networks import Encoder, perceptron


class QNetwork(nn.Module):
    """Q values (..., n, A) of observation leaves (..., n, *shape); linear in them without hidden layers."""

    def __init__(
        self, group: Group, hidden: tuple[int, ...], actions: int, *, duelling: bool, memory: int = 0
    ) -> None:
        super().__init__()
        self.encoder = encoder_of(group)
        self.trunk = perceptron([self.encoder.size, *hidden], nn.ReLU)
        if hidden:
            self.trunk.append(nn.ReLU())
        width = hidden[-1] if hidden else self.encoder.size
        self.memory = GRUMemory(width, memory) if memory else None
        self.advantage = nn.Linear(memory or width, actions)
        self.value = nn.Linear(memory or width, 1) if duelling else None

    def forward(self, leaves) -> Tensor:
        """Return Q values of single moments."""
        features = self.trunk(self.encoder(leaves))
        if self.memory is not None:
            features = self.memory(features, leaves[MEMORY], None, 1)
        return self.values(features, leaves)

    def forward_recurrent(self, view: GroupView) -> tuple[Tensor, Tensor]:
        """Return (Q values, memory afterwards) of moments or sequences; without memory, (Q, features)."""
        features = self.trunk(self.encoder(view.observations))
        if self.memory is not None:
            features = self.memory(features, view.observations[MEMORY], view.fresh, view.length)
        return self.values(features, view.observations), features

    def values(self, features: Tensor, leaves: Mapping[str, Tensor]) -> Tensor:
        """Return Q values of features."""
        return self.duel(self.advantage(features), None if self.value is None else self.value(features))

    @staticmethod
    def duel(advantage: Tensor, value: Tensor | None) -> Tensor:
        """Return Q values; duelling as V + A - mean A."""
        return advantage if value is None else value + advantage - advantage.mean(-1, keepdim=True)

    def folded(self) -> nn.Sequential:
        """Return an equal perceptron."""
        return nn.Sequential(*self.trunk, folded_streams(self.advantage, self.value))


def folded_streams(advantage: nn.Linear, value: nn.Linear | None) -> nn.Linear:
    """Return one layer equal to both duelling streams, which are linear in the same features."""
    last = nn.Linear(advantage.in_features, advantage.out_features)
    with torch.no_grad():
        weight, bias = advantage.weight, advantage.bias
        if value is not None:
            weight = weight - weight.mean(0, keepdim=True) + value.weight
            bias = bias - bias.mean() + value.bias
        last.weight.copy_(weight)
        last.bias.copy_(bias)
    return last


class DQNModule(JointModule):
    """Q network and its target."""

    targets = ("target_q",)

    def make_head(self) -> Head:
        """Act epsilon-greedily."""
        return EpsilonGreedyHead(self.group.action)

    def make_networks(self) -> None:
        """Create the Q network and its target."""
        sizes = (self.group, self.settings["hidden"], self.head.outputs)
        kind = {"duelling": self.settings["duelling"], "memory": self.memory_size}
        self.q = QNetwork(*sizes, **kind)
        # Drawn, not copied, so that the networks built after it begin as they did when scores were measured.
        self.target_q = QNetwork(*sizes, **kind).requires_grad_(False)
        self.target_q.load_state_dict(self.q.state_dict())

    def policy(self, view: GroupView) -> Tensor:
        """Return Q values (M, n, A)."""
        return self.q.forward_recurrent(view)[0]

    def forward_recurrent(self, view: GroupView) -> tuple[Tensor, Tensor]:
        """Return (Q values, memory afterwards)."""
        return self.q.forward_recurrent(view)

    def feedforward_parts(self) -> tuple[Encoder, nn.Module] | None:
        """Return encoder and body, for stacked acting, with the duelling streams folded into one layer."""
        if self.memory_size:
            return None
        return self.q.encoder, self.q.folded()


class DQNLearner(OffPolicyLearner):
    """Temporal-difference steps, group by group."""

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Step every Q network towards its bootstrapped target."""
        losses, surprise = {}, {}
        for group, own in batch.groups():
            net = self.net(group.id)
            chosen = net.policy(own).gather(-1, own.actions.unsqueeze(-1)).squeeze(-1)
            target = self.td_target(own, self.next_value(net, *self.following(net, own)))
            error = nn.functional.smooth_l1_loss(chosen, target, reduction="none")
            loss = self.mean(error if batch.weights is None else error * batch.weights[:, None], own.alive)
            if group.id not in batch.absent:
                losses[group.id] = loss
                self.log(group.id, "td_loss", loss)
            surprise[group.id] = (chosen - target).detach().abs()
        self.step_each(losses)
        self.reprioritise(batch, batch.join(surprise))
        self.polyak_update(*(g.id for g in self.groups), tau=self.config.tau)

    def make_replay(self) -> JointReplay:
        """Return an empty replay buffer: prioritised, of sequences, or plain."""
        if not self.config.prioritised:
            return super().make_replay()
        alpha, beta = self.config.priority_alpha, self.config.priority_beta
        return PrioritisedReplay(self.spec, self.config.capacity, alpha=alpha, beta=beta)

    def reprioritise(self, batch: ReplayBatch, surprise: Tensor) -> None:
        """Set priorities to the mean over active agents of absolute differences (M, N)."""
        if isinstance(self.replay, PrioritisedReplay) and batch.rows is not None:
            mean = torch.where(batch.alive, surprise, 0).sum(-1) / batch.alive.sum(-1).clamp(min=1)
            self.replay.reprioritise(self.parallel.whole(batch.rows), self.parallel.whole(mean))

    def following(self, net: DQNModule, own: ReplayGroup) -> tuple[GroupView, GroupView]:
        """Return what the agents see next, with the online and with the target network's own memory."""
        if not net.memory_size:
            return own.next, own.next
        with torch.no_grad():
            memories = net.q.forward_recurrent(own)[1], net.target_q.forward_recurrent(own)[1]
        # An agent that did not act before, or whose trajectory ended, begins with the empty memory
        # that is stored.
        stored, same = own.next.observations[MEMORY], own.bootstrap[..., None]
        online, target = (
            replace(
                own.next, observations={**own.next.observations, MEMORY: torch.where(same, memory, stored)}
            )
            for memory in memories
        )
        return online, target

    def next_value(self, net: DQNModule, view: GroupView, target_view: GroupView | None = None) -> Tensor:
        """Return the target network's value (M, n) of the best action that the mask allows."""
        with torch.no_grad():
            values = net.target_q((target_view or view).observations)
            ranking = net.policy(view) if self.config.double else values
            return values.gather(-1, best_actions(ranking, view).unsqueeze(-1)).squeeze(-1)


def best_actions(values: Tensor, view: GroupView) -> Tensor:
    """Return the actions (M, n) of the highest values (M, n, A) that the mask allows."""
    if view.action_mask is not None:
        values = values.masked_fill(~view.action_mask, MASKED_LOGIT)
    return values.argmax(-1)


class DQNConfig(JointConfig):
    """RLlib config of independent DQN."""

    algorithm = "dqn"
    policy_module = DQNModule
    network_settings = ("duelling",)
    explores_by = "epsilon"


class DQN(JointAlgorithm):
    """Independent DQN."""

    config_class = DQNConfig
    learner_class = DQNLearner
