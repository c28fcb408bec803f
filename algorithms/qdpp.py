"""Multi-agent determinantal Q-learning (Q-DPP): a joint action is worth its quality and its diversity.

Yang et al. 2020, "Multi-Agent Determinantal Q-Learning". A determinantal point process over all pairs (o_i,
a_i), of which one of each agent is taken (a partition matroid), gives a joint action the weight det L_Y with
L_Y = D B^T B D. Its logarithm is the team's value (eq. 6),

    Q(o, a) = log det L_Y = sum_i Q_i(o_i, a_i) + log det(B^T B),

where D holds the qualities exp(Q_i(o_i, a_i) / 2), and the columns of B are vectors b_i(o_i, a_i), of length
1. The second term is never positive, and 0 exactly if the agents' vectors are orthogonal. The orthogonalising
sampler (the paper's algorithm 1) draws agent after agent, a_i with weight

    exp(Q_i(o_i, a_i)) * (squared length of what of b_i(o_i, a_i) is orthogonal to the vectors taken before),

so that the joint action has the weight det L_Y over the product of the normalisers. Its most probable choices
are what greedy agents do, and the next joint action that targets bootstrap from.

In the code each agent is greedy alone: it takes its own best action. These are the best joint action if their
vectors are orthogonal, but the loss fits only the sum: large qualities whose vectors are parallel fit it as
well, and such agents choose a joint action that the team values little.

These are the equations of the authors' code (QDPP-GitHub/QDPP), which names lines of algorithm 1, of the
paper's supplement beside that code, which names eq. 6, and of lecture notes by one of the authors. The main
text of the paper could not be read. As in the code, the order is that of the agents, the online networks
choose the next joint action and the target networks value it.

Deviations, where "the code" is the authors':

- A share `own_share` of each squared vector lies in a direction that no other agent has, which bounds the
  determinant from below. The code adds noise, uniform up to 0.1, to the diagonal of B^T B and clips its
  entries at 0.
- An inactive agent has only that direction and quality 0, so it changes nothing.
- Vectors are functions of the own observation on the trunk of Q_i. The code has tables of finite states, and
  for others networks of the global state (the supplement's "Deep Q-DPP").
- Vectors have length 1. The code's have at most this length, which is learned and adds to the value.
- Weights have the power 1 / `temperature`; the code divides Q_i only. As it falls, agents that explore come
  to the greedy joint action, and the code's to their own best actions.
- Greedy agents act in turn, for which they need each other's vectors; an agent that is asked alone takes its
  own best action.
- Targets take the sampler's choices at temperature 1, the code's at half of the present one.
- There is no penalty on the balance of singular values, which only the sampler's error bound needs, no decay
  of weights and no limit on values.
- Agents may share networks, and have no memory; the code's have networks of their own, most of them
  recurrent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Generator, Tensor, nn

from algorithms.dqn import DQNModule, QNetwork
from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, JointView, ReplayBatch
from algorithms.joint.config import JointConfig
from algorithms.joint.spec import Group
from algorithms.joint.team import TeamLearner
from algorithms.parts.distributions import CategoricalDistribution, Exploration, SampledActions
from algorithms.parts.masking import MASKED_LOGIT


class Items(NamedTuple):
    """What n agents can do.

    Attributes:
        quality: Q_i(o_i, a_i), (M, n, A); 0 for inactive agents.
        vectors: Diversity vectors of length 1, (M, n, A, D).
        action_mask: Allowed actions (M, n, A), or None.
    """

    quality: Tensor
    vectors: Tensor
    action_mask: Tensor | None

    def of(self, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Return quality (M, n) and vectors (M, n, D) of actions (M, n)."""
        numbers = (torch.arange(size, device=actions.device) for size in actions.shape)
        rows, agents = torch.meshgrid(*numbers, indexing="ij")
        return self.quality[rows, agents, actions], self.vectors[rows, agents, actions]


def log_volume(vectors: Tensor) -> Tensor:
    """Return log det(B^T B) (M,) of the agents' vectors (M, N, D), 0 if they are orthogonal."""
    return torch.logdet(vectors @ vectors.transpose(-1, -2))


def choose_in_turn(
    items: Sequence[Items], choose: Callable[[Tensor], Tensor], temperature: float = 1.0
) -> list[SampledActions]:
    """Return actions of all agents, chosen one after another by the logarithms of their weights (M, A).

    The logarithms are divided by the temperature; at 1 the sampler is the paper's.
    """
    taken: list[Tensor] = []
    chosen = []
    for each in items:
        actions, chances = [], []
        for i in range(each.quality.shape[1]):
            left = each.vectors[:, i]
            for vector in taken:
                left = left - (left @ vector[..., None]) * vector[:, None]
            weights = (each.quality[:, i] + left.square().sum(-1).log()) / temperature
            if each.action_mask is not None:
                weights = weights.masked_fill(~each.action_mask[:, i], MASKED_LOGIT)
            actions.append(choose(weights))
            chances.append(weights.softmax(-1))
            vector = left[torch.arange(len(left), device=left.device), actions[-1]]
            taken.append(nn.functional.normalize(vector, dim=-1))
        chosen.append(SampledActions(torch.stack(actions, 1), None, torch.stack(chances, 1)))
    return chosen


def greedy_in_turn(items: Sequence[Items]) -> list[SampledActions]:
    """Return each group's most probable actions, given those of the agents before."""
    return choose_in_turn(items, lambda weights: weights.argmax(-1))


class DiverseQNetwork(QNetwork):
    """Q_i(o_i, .), and vectors of `size` numbers for all actions."""

    def __init__(
        self, group: Group, hidden: tuple[int, ...], actions: int, size: int, *, duelling: bool
    ) -> None:
        super().__init__(group, hidden, actions, duelling=duelling)
        self._shape = actions, size
        self.diversity = nn.Linear(self.advantage.in_features, actions * size)

    def values_and_vectors(self, view: GroupView) -> tuple[Tensor, Tensor]:
        """Return Q_i (M, n, A) and vectors of length 1 (M, n, A, `size`)."""
        features = self.trunk(self.encoder(view.observations))
        vectors = self.diversity(features).unflatten(-1, self._shape)
        return self.values(features, view.observations), nn.functional.normalize(vectors, dim=-1)


class QDPPModule(DQNModule):
    """Qualities and diversity vectors, and their targets. Agents act in turn."""

    acts_jointly = True

    def make_networks(self) -> None:
        """Create the network."""
        sizes = self.settings["hidden"], self.head.outputs, self.settings["features"]
        self.q = DiverseQNetwork(self.group, *sizes, duelling=self.settings["duelling"])
        places = torch.eye(len(self.spec.agents))[self.group.columns]
        self.places = nn.Buffer(places, persistent=False)

    def items(self, view: GroupView, q: DiverseQNetwork) -> Items:
        """Return what the agents can do, by a network."""
        quality, vectors = q.values_and_vectors(view)
        alive, own = view.alive[..., None], self.settings["own_share"]
        there = alive[..., None]
        common = torch.where(there, (1 - own) ** 0.5 * vectors, 0)
        private = torch.where(there, own**0.5, 1.0) * self.places[:, None]
        vectors = torch.cat([common, private.expand(*common.shape[:-1], -1)], -1)
        return Items(torch.where(alive, quality, 0), vectors, view.action_mask)

    @classmethod
    def act_jointly(
        cls,
        modules: Sequence[QDPPModule],  # type: ignore[override]
        views: Sequence[GroupView],
        exploration: Exploration,
        generator: Generator,
    ) -> list[SampledActions]:
        """Return actions by the orthogonalising sampler, or its most probable choices."""
        items = [net.items(view, net.q) for net, view in zip(modules, views, strict=True)]
        if not exploration.explore:
            return greedy_in_turn(items)
        return choose_in_turn(
            items, lambda weights: CategoricalDistribution(weights).sample(generator), exploration.temperature
        )

    def feedforward_parts(self) -> None:
        """Return None: agents that explore are not evaluated one by one."""


class QDPPLearner(TeamLearner):
    """One temporal difference for the whole team."""

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Step all networks together towards the team's target."""
        taken = [own.actions for _, own in batch.groups()]
        total, diversity = self.worth(batch, self.items(batch, "q"), taken)
        there = batch.alive.any(-1)
        loss = self.mean((total - self.targets(batch)).square(), there)
        self.step_optimizer(loss, *(group.id for group in self.groups if group.id not in batch.absent))
        self.log(self.groups[0].id, "td_loss", loss)
        self.log(self.groups[0].id, "diversity", self.mean(diversity, there))
        self.polyak_update(*(group.id for group in self.groups), tau=self.config.tau)

    @torch.no_grad()
    def targets(self, batch: ReplayBatch) -> Tensor:
        """Return r + gamma Q'(o', a') (M,), a' the greedy joint action."""
        following = batch.next
        valued = self.items(following, "target_q")
        ranked = self.items(following, "q") if self.config.double else valued
        chosen = [each.actions for each in greedy_in_turn(list(ranked.values()))]
        value = self.worth(following, valued, chosen)[0]
        value = torch.where(following.alive.any(-1), value, 0)
        return self.reward(batch) + self.gamma * value

    def items(self, view: JointView, network: str) -> dict[str, Items]:
        """Return what all agents can do by group id, by the networks of this name."""
        nets = {group.id: self.net(group.id) for group in self.groups}
        return {g.id: nets[g.id].items(view.view(g), getattr(nets[g.id], network)) for g in self.groups}

    def worth(
        self, view: JointView, items: Mapping[str, Items], actions: Sequence[Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Return (Q(o, a), its log det(B^T B)), (M,), of each group's actions (M, n)."""
        parts = {name: each.of(own) for (name, each), own in zip(items.items(), actions, strict=True)}
        quality = view.join({name: part[0] for name, part in parts.items()})
        diversity = log_volume(view.join({name: part[1] for name, part in parts.items()}))
        return quality.sum(-1) + diversity, diversity


class QDPPConfig(JointConfig):
    """RLlib config of Q-DPP."""

    algorithm = "qdpp"
    policy_module = QDPPModule
    network_settings = ("duelling", "features", "own_share")
    explores_by = "temperature"


class QDPP(JointAlgorithm):
    """Q-DPP."""

    config_class = QDPPConfig
    learner_class = QDPPLearner
