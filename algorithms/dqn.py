"""Independent deep Q-learning, double and duelling.

Every group of agents fits Q(o_i, a_i) as if the others were part of its environment (Tampuu et al. 2017).
Mnih et al. 2015, "Human-level control through deep reinforcement learning": replay and target network, eq. 1
with the Huber loss; van Hasselt et al. 2016: the online network chooses the next action and the target
network values it; Wang et al. 2016, eq. 9: duelling value and advantage streams.

Deviations: target networks follow by polyak averaging instead of periodic copies.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, ReplayBatch
from algorithms.joint.config import OffPolicyConfig
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import JointModule
from algorithms.joint.spec import Group, JointSpec
from algorithms.parts.distributions import EpsilonGreedyHead, Exploration, Head
from algorithms.parts.masking import ILLEGAL
from algorithms.parts.networks import Encoder, perceptron


class QNetwork(nn.Module):
    """Q values (..., n, A) of observation leaves (..., n, *shape)."""

    def __init__(self, group: Group, hidden: tuple[int, ...], actions: int, *, duelling: bool) -> None:
        super().__init__()
        self.encoder = Encoder(group.observation, group.size)
        self.trunk = perceptron([self.encoder.size, *hidden], nn.ReLU).append(nn.ReLU())
        self.advantage = nn.Linear(hidden[-1], actions)
        self.value = nn.Linear(hidden[-1], 1) if duelling else None

    def forward(self, leaves) -> Tensor:
        """Return Q values; duelling as V + A - mean A."""
        features = self.trunk(self.encoder(leaves))
        advantage = self.advantage(features)
        if self.value is None:
            return advantage
        return self.value(features) + advantage - advantage.mean(-1, keepdim=True)

    def folded(self) -> nn.Sequential:
        """Return an equal perceptron: both streams are linear in the same features."""
        last = nn.Linear(self.advantage.in_features, self.advantage.out_features)
        with torch.no_grad():
            weight, bias = self.advantage.weight, self.advantage.bias
            if self.value is not None:
                weight = weight - weight.mean(0, keepdim=True) + self.value.weight
                bias = bias - bias.mean() + self.value.bias
            last.weight.copy_(weight)
            last.bias.copy_(bias)
        return nn.Sequential(*self.trunk, last)


class DQNModule(JointModule):
    """Q network and its target."""

    targets = ("target_q",)

    def make_head(self) -> Head:
        """Act epsilon-greedily."""
        return EpsilonGreedyHead(self.group.action)  # type: ignore[arg-type]

    def make_networks(self) -> None:
        """Create the Q network and its target."""
        sizes = (self.group, self.settings["hidden"], self.head.outputs)
        self.q = QNetwork(*sizes, duelling=self.settings["duelling"])
        self.target_q = QNetwork(*sizes, duelling=self.settings["duelling"]).requires_grad_(False)
        self.target_q.load_state_dict(self.q.state_dict())

    def policy(self, view: GroupView) -> Tensor:
        """Return Q values (M, n, A)."""
        return self.q(view.observations)

    def plain(self) -> tuple[Encoder, nn.Module]:
        """Return encoder and body, for stacked acting, with the duelling streams folded into one layer."""
        return self.q.encoder, self.q.folded()


class DQNLearner(OffPolicyLearner):
    """Temporal-difference steps, group by group."""

    config: DQNConfig  # type: ignore[assignment]

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Step every Q network towards its bootstrapped target."""
        for group, own in batch.groups():
            net = self.net(group.id)
            chosen = net.policy(own).gather(-1, own.actions.unsqueeze(-1)).squeeze(-1)
            following = torch.where(own.bootstrap, self.next_value(net, own.next), 0)
            target = self.config.reward_scale * own.rewards + self.gamma * following
            error = nn.functional.smooth_l1_loss(chosen, target, reduction="none")
            loss = self.mean(error, own.alive)
            self.step_optimizer(loss, group.id)
            self.log(group.id, "td_loss", loss)
        self.track(*(g.id for g in self.groups), tau=self.config.tau)

    def next_value(self, net: DQNModule, view: GroupView) -> Tensor:
        """Return the target network's value (M, n) of the action that looks best; illegal ones never do."""
        with torch.no_grad():
            values = net.target_q(view.observations)
            ranking = net.policy(view) if self.config.double else values
            if view.legal is not None:
                ranking = ranking.masked_fill(~view.legal, ILLEGAL)
            return values.gather(-1, ranking.argmax(-1, keepdim=True)).squeeze(-1)


class DQNConfig(OffPolicyConfig):
    """Independent DQN.

    Attributes:
        double: Choose the next action by the online network.
        duelling: Separate streams for value and advantage.
        epsilon: (first, last) probability of a random action.
        epsilon_steps: Environment steps from the first to the last.
    """

    algorithm = "dqn"

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class or DQN)
        self._defaults(double=True, duelling=True, epsilon=(1.0, 0.05), epsilon_steps=10_000)

    double: bool
    duelling: bool
    epsilon: tuple[float, float]
    epsilon_steps: int

    def exploration(self, steps: int) -> Exploration:
        """Return epsilon-greedy exploration, annealed linearly."""
        first, last = self.epsilon
        done = min(steps / max(self.epsilon_steps, 1), 1.0)
        return Exploration(explore=bool(self.explore), epsilon=first + (last - first) * done)

    def module_settings(self):
        """Return the settings that networks are built from."""
        return super().module_settings() | {"duelling": self.duelling}

    def modules(self, spec: JointSpec):
        """Return a Q network for each group."""
        return {g.id: self.policy_spec(spec, g, DQNModule) for g in spec.groups}

    def get_default_learner_class(self):
        """Return the learner (RLlib)."""
        return DQNLearner


class DQN(JointAlgorithm):
    """Independent DQN."""

    @classmethod
    def get_default_config(cls) -> DQNConfig:
        """Return the defaults (RLlib)."""
        return DQNConfig()
