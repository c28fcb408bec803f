"""Q-learning with supervised models of the other agents (joint-action learning).

Claus & Boutilier 1998, "The Dynamics of Reinforcement Learning in Cooperative Multiagent Systems", and with
networks He et al. 2016, "Opponent Modeling in Deep Reinforcement Learning": agent i learns the value
Q_i(o_i, a_i, a_-i) of all agents' actions, and a model p_ij(a_j | o_i) of each other agent j, from the
actions that j has taken (cross-entropy). The value of an own action is its expectation under the models,

    Q_i(o_i, a_i) = E over a_j ~ p_ij(. | o_i) of Q_i(o_i, a_i, a_-i).

Agent i takes the best action, and bootstraps with the maximum over a_i of Q_i(o_i', a_i). Q_i(o_i, a_i, a_-i)
stays true when the others change and only the models must follow, so the models are fitted to the newest
rollout and Q_i to replay.

Deviations: Q_i(o, a_i, a_-i) = q_i(o, a_i) + sum_j q_ij(o, a_i, a_j), which is exact for two agents and makes
the expectation exact for any number; absence is one more action of an agent, which adds nothing to the value;
the Huber loss, and target networks by polyak averaging.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from algorithms.dqn import DQN, DQNConfig
from algorithms.errors import SpaceError
from algorithms.joint.batch import GroupView, JointBatch, JointView, ReplayBatch, to_tensor
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import JointModule
from algorithms.joint.rollout import JointRollout
from algorithms.joint.spec import Group, JointSpec, action_size
from algorithms.parts.distributions import EpsilonGreedyHead, Head
from algorithms.parts.masking import MASKED_LOGIT
from algorithms.parts.networks import Encoder, perceptron


class Trunk(nn.Module):
    """Features (M, n, `size`) of observation leaves."""

    def __init__(self, group: Group, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.encoder = Encoder(group.observation, group.places, group.set_width)
        sizes = [self.encoder.size, *hidden]
        self.body = perceptron(sizes, nn.ReLU)
        if hidden:
            self.body.append(nn.ReLU())
        self.size = sizes[-1]

    def forward(self, leaves) -> Tensor:
        """Return the features."""
        return self.body(self.encoder(leaves))


class PairwiseQ(nn.Module):
    """q_i(o, a_i) and q_ij(o, a_i, a_j) of a group's agents i and all agents j, 0 for j = i.

    Args:
        spec: All N agents, with at most A actions.
        group: The n agents, with K actions.
        hidden: Widths of hidden layers.
    """

    def __init__(self, spec: JointSpec, group: Group, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self._shape = action_size(group.action), len(spec.agents), most_actions(spec)
        self.trunk = Trunk(group, hidden)
        self.own = nn.Linear(self.trunk.size, self._shape[0])
        self.pairs = nn.Linear(self.trunk.size, int(np.prod(self._shape)))
        self.others = nn.Buffer(others_of(spec, group), persistent=False)

    def forward(self, leaves) -> tuple[Tensor, Tensor]:
        """Return q_i (M, n, K) and q_ij (M, n, K, N, A)."""
        features = self.trunk(leaves)
        pairs = self.pairs(features).unflatten(-1, self._shape)
        return self.own(features), pairs * self.others[:, None, :, None]


class OpponentModel(nn.Module):
    """p_ij(a_j | o_i) of a group's agents i and all agents j; the last of A + 1 actions is absence."""

    def __init__(self, spec: JointSpec, group: Group, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self._shape = len(spec.agents), most_actions(spec) + 1
        self.trunk = Trunk(group, hidden)
        self.last = nn.Linear(self.trunk.size, int(np.prod(self._shape)))
        self.possible = nn.Buffer(possible_actions(spec), persistent=False)

    def forward(self, leaves) -> Tensor:
        """Return log-probabilities (M, n, N, A + 1)."""
        logits = self.last(self.trunk(leaves)).unflatten(-1, self._shape)
        return logits.masked_fill(~self.possible, MASKED_LOGIT).log_softmax(-1)


def most_actions(spec: JointSpec) -> int:
    """Return the largest number A of actions of an agent."""
    return max(action_size(block.action) for block in spec.spaces.blocks)


def others_of(spec: JointSpec, group: Group) -> Tensor:
    """Return 1 where agent j is another than the group's agent i, (n, N)."""
    names = np.array(spec.agents)
    return torch.from_numpy((np.array(group.agents)[:, None] != names).astype(np.float32))


def possible_actions(spec: JointSpec) -> Tensor:
    """Return which of A actions each agent has, and last that it may be absent, (N, A + 1)."""
    counts = [action_size(block.action) for block in spec.spaces.blocks for _ in block.agents]
    numbers = torch.arange(most_actions(spec) + 1)
    return (numbers < torch.tensor(counts)[:, None]) | (numbers == most_actions(spec))


class OpponentQModule(JointModule):
    """Q network with its target, and the model of the others."""

    targets = ("target_q",)

    def make_head(self) -> Head:
        """Act epsilon-greedily."""
        return EpsilonGreedyHead(self.group.action)

    def make_networks(self) -> None:
        """Create all networks."""
        self.q = PairwiseQ(self.spec, self.group, self.settings["hidden"])
        self.model = OpponentModel(self.spec, self.group, self.settings["hidden"])

    def policy(self, view: GroupView) -> Tensor:
        """Return the values (M, n, K) of own actions."""
        return self.values(view, self.q)

    def values(self, view: GroupView, q: PairwiseQ) -> Tensor:
        """Return the values (M, n, K) of own actions by a Q network, given what is expected of the others."""
        own, pairs = q(view.observations)
        return own + (pairs * self.expected(view, pairs)).sum((-1, -2))

    def expected(self, view: GroupView, pairs: Tensor) -> Tensor:
        """Return how probable it expects the others' actions to be, (M, n, 1 or K, N, A)."""
        with torch.no_grad():
            return self.model(view.observations)[..., :-1].exp().unsqueeze(-3)


class OpponentQLearner(OffPolicyLearner):
    """Models from the newest rollout, temporal-difference steps from replay."""

    def update_joint(self, rollout: JointRollout) -> None:
        """Fit the models to a rollout, then learn from replay."""
        view = JointView.of(self.spec, rollout.views[:-1], self._device).flat()
        actions = tuple(to_tensor(taken, self._device).flatten(0, 1) for taken in rollout.actions)
        deeds = self.deeds(view, actions)
        for _ in range(self.config.model_steps):
            self.fit_models(view, deeds)
        super().update_joint(rollout)

    def deeds(self, view: JointView, actions: tuple[Tensor, ...]) -> Tensor:
        """Return what each agent did: its action, or A if it was not there, (M, N)."""
        return torch.where(view.alive, torch.cat(actions, -1), most_actions(self.spec))

    def fit_models(self, view: JointView, deeds: Tensor) -> None:
        """Take a step on the cross-entropy of what the others did."""
        losses = {}
        for group in (group for group in self.groups if group.id not in view.absent):
            own, net = view.view(group), self.net(group.id)
            expected = net.model(own.observations)
            did = deeds[:, None, :, None].expand(*expected.shape[:-1], 1)
            surprise = -expected.gather(-1, did).squeeze(-1)
            others = net.q.others.bool() & own.alive[..., None]
            losses[group.id] = self.mean(surprise, others)
            self.log(group.id, "opponent_loss", losses[group.id])
            hit = (expected.argmax(-1) == did.squeeze(-1)).float()
            self.log(group.id, "opponent_accuracy", self.mean(hit, others))
        self.step_each(losses)

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Step every Q network towards its bootstrapped target."""
        taken, losses = self.one_hot(batch), {}
        for group, own in batch.present():
            net = self.net(group.id)
            alone, pairs = net.q(own.observations)
            values = alone + (pairs * taken[:, None, None]).sum((-1, -2))
            chosen = values.gather(-1, own.actions.unsqueeze(-1)).squeeze(-1)
            target = self.td_target(own, self.next_value(net, own.next))
            error = nn.functional.smooth_l1_loss(chosen, target, reduction="none")
            losses[group.id] = self.mean(error, own.alive)
            self.log(group.id, "td_loss", losses[group.id])
        self.step_each(losses)
        self.polyak_update(*(group.id for group in self.groups), tau=self.config.tau)

    def one_hot(self, batch: JointBatch) -> Tensor:
        """Return what all agents did, (M, N, A), zeros for those that were not there."""
        deeds = self.deeds(batch, batch.actions)
        return nn.functional.one_hot(deeds, most_actions(self.spec) + 1)[..., :-1].float()

    def next_value(self, net: OpponentQModule, view: GroupView) -> Tensor:
        """Return the target network's value (M, n) of the best action that the mask allows."""
        with torch.no_grad():
            values = net.values(view, net.target_q)
            if view.action_mask is not None:
                values = values.masked_fill(~view.action_mask, MASKED_LOGIT)
            return values.max(-1).values


class OpponentQConfig(DQNConfig):
    """RLlib config of Q-learning with models of the others."""

    algorithm = "opponent_q"
    network_settings = ()
    policy_module = OpponentQModule

    def check(self, spec: JointSpec) -> None:
        """Raise if the algorithm cannot handle the environment; see `JointConfig.check`.

        Raises:
            SpaceError: There is one agent only.
        """
        super().check(spec)
        if len(spec.agents) == 1:
            raise SpaceError(
                f"{self.algorithm!r} models other agents, but {spec.agents[0]!r} is alone",
                place="environment",
                remedy="use 'dqn', or an environment with at least two agents",
            )


class OpponentQ(DQN):
    """Q-learning with models of the others."""

    config_class = OpponentQConfig
    learner_class = OpponentQLearner
