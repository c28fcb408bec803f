"""Networked fitted Q-iteration ("Net-Q"): agents that fit the team's value by talking to neighbours.

Zhang, Yang, Liu, Zhang & Başar 2018, "Finite-Sample Analysis for Decentralized Batch Multi-Agent
Reinforcement Learning with Networked Agents" (arXiv:1812.02783; the version in IEEE TAC 2021 has two
competing teams), the collaborative setting. Every agent sees the state and the joint action, but only its own
reward; the team wants the mean of all rewards. Each agent i keeps a Q_i(s, a) of the *joint* action. In
iteration k it sets its own targets

    Y_i = r_i + gamma * Q_i,k(s', a'),    a' the best joint action in s'

and all agents together solve, over a graph that may vary with time,

    minimise over f   (1 / N) * sum over i and samples of (Y_i - f(s, a))^2

which no agent can evaluate, by distributed optimisation with consensus: gradient tracking (DIGing of Nedić,
Olshevsky & Shi 2017), with the doubly stochastic Metropolis weights C:

    g_i <- sum_j C_ij (g_j + grad_i,l - grad_i,l-1)       what agents know of the mean gradient
    w_i <- sum_j C_ij (w_j - step along g_j)              their parameters

Iterations end with `agreement_rounds` of averaging, so that agents agree before the next max. Greedy play
takes the agent's own part of the best joint action.

Deviations: adapt-then-combine order, in which both exchanges happen after the local part (a complete graph is
then exactly the centralised fit); steps by Adam on the tracked gradient; every step on a fresh minibatch from
replay that all agents share, instead of one fixed batch; double Q-learning (`double=False`: the paper's
maximum over target values) and duelling streams; the state is all observations, encoded, with which agents
are active, zeros for absent agents, whose only action is number 0; a group of agents that share a network is
one node, whose weight is its size.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import prod
from typing import Any

import torch
from torch import Tensor, nn

from algorithms.dqn import QNetwork, folded_streams
from algorithms.errors import SpaceError
from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, ReplayBatch
from algorithms.joint.config import JointConfig
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import JointModule
from algorithms.joint.neighbours import Neighbourhood
from algorithms.joint.spec import Group, JointSpec, action_size
from algorithms.maac import of_actions
from algorithms.parts.distributions import EpsilonGreedyHead, Head
from algorithms.parts.graph import consensus_rate, metropolis
from algorithms.parts.masking import MASKED_LOGIT
from algorithms.parts.networks import Encoder


class JointTable(nn.Module):
    """Q(s, .) of every joint action, (M, P), from what all groups' agents see and which are active.

    One encoder reads the observations of all agents of equal spaces. Duelling as `QNetwork`.
    """

    def __init__(
        self, groups: Sequence[Group], hidden: tuple[int, ...], actions: int, *, duelling: bool
    ) -> None:
        super().__init__()
        encoders = {str(g.block): Encoder(g.observation, set_width=g.set_width) for g in groups}
        self._blocks = [str(group.block) for group in groups]
        self.encoders = nn.ModuleDict(encoders)
        size = sum(g.size * (encoders[b].size + 1) for g, b in zip(groups, self._blocks, strict=True))
        self.trunk = nn.Sequential(
            *(layer for sizes in pairwise([size, *hidden]) for layer in (nn.Linear(*sizes), nn.ReLU()))
        )
        width = [size, *hidden][-1]
        self.advantage = nn.Linear(width, actions)
        self.value = nn.Linear(width, 1) if duelling else None

    def forward(self, views: Sequence[GroupView]) -> Tensor:
        """Return the values."""
        parts = []
        for block, view in zip(self._blocks, views, strict=True):
            seen = self.encoders[block](view.observations) * view.alive[..., None]
            parts += [seen.flatten(1), view.alive.float()]
        features = self.trunk(torch.cat(parts, -1))
        return QNetwork.duel(self.advantage(features), None if self.value is None else self.value(features))

    def folded(self) -> nn.Sequential:
        """Return a perceptron with the same outputs of encoded observations."""
        return nn.Sequential(*self.trunk, folded_streams(self.advantage, self.value))


class JointActions:
    """All combinations of the agents' discrete actions, agents in the order of the groups."""

    def __init__(self, groups: Sequence[Group]) -> None:
        self.sizes = tuple(action_size(group.action) for group in groups for _ in group.agents)
        self._groups = groups

    def number(self, actions: Sequence[Tensor]) -> Tensor:
        """Return the number (M,) of the combination of actions, (M, n) of each group."""
        number = torch.zeros_like(actions[0][:, 0])
        for size, action in zip(self.sizes, torch.cat(list(actions), 1).unbind(1), strict=True):
            number = number * size + action
        return number

    def masked_values(self, values: Tensor, views: Sequence[GroupView]) -> Tensor:
        """Return values (M, A_1, ..., A_N) of joint actions (M, P), the impossible ones far below."""
        table, agent = values.unflatten(-1, self.sizes), 0
        for group, view in zip(self._groups, views, strict=True):
            for place in range(group.size):
                shape = [len(table)] + [1] * len(self.sizes)
                shape[agent + 1] = self.sizes[agent]
                table = table.masked_fill(
                    ~self._possible(view, place, self.sizes[agent]).view(shape), MASKED_LOGIT
                )
                agent += 1
        return table

    def own_values(self, table: Tensor, group: Group) -> Tensor:
        """Return for a group's agents the best value (M, n, A) that each own action allows the team.

        Among equally good joint actions all nodes mean the first: its parts are raised by the least that a
        number can be, so that agents of equal networks never act out parts of different ones.
        """
        best = table.flatten(1).argmax(1)
        first = sum(other.size for other in self._groups[: self._groups.index(group)])
        columns = []
        for agent in range(first, first + group.size):
            rest = [k + 1 for k in range(len(self.sizes)) if k != agent]
            values = table.amax(rest) if rest else table
            part = (best // prod(self.sizes[agent + 1 :]) % self.sizes[agent]).unsqueeze(1)
            raised = values.gather(1, part)
            columns.append(values.scatter(1, part, raised.nextafter(torch.full_like(raised, torch.inf))))
        return torch.stack(columns, 1)

    @staticmethod
    def _possible(view: GroupView, place: int, size: int) -> Tensor:
        there = view.alive[:, place, None]
        action_mask = (
            torch.ones_like(there).expand(-1, size)
            if view.action_mask is None
            else view.action_mask[:, place]
        )
        return torch.where(there, action_mask, torch.arange(size, device=there.device) == 0)


def absent_view(group: Group, like: GroupView) -> GroupView:
    """Return what a group sees whose agents are not there, in as many rows as another view."""
    there = like.alive.new_zeros(len(like.alive), group.size)
    return GroupView(
        {
            n: there.new_zeros(*there.shape, *s.shape, dtype=torch.float32)
            for n, s in group.observation.items()
        },
        there,
        None,
    )


class NetworkedQModule(JointModule):
    """A group's value of every joint action, and its target."""

    targets, joins = ("target_q",), "observations"
    communicates = True

    def make_head(self) -> Head:
        """Act epsilon-greedily."""
        return EpsilonGreedyHead(self.group.action)

    def make_networks(self) -> None:
        """Create the Q network."""
        self.combinations = JointActions(self.spec.groups)
        sizes = self.settings["hidden"], prod(self.combinations.sizes)
        self.q = JointTable(self.spec.groups, *sizes, duelling=self.settings["duelling"])

    def policy(self, view: GroupView) -> Tensor:
        """Return the outputs of a group that is alone: the others' agents are not there."""
        views = [
            view if group.id == self.group.id else absent_view(group, view) for group in self.spec.groups
        ]
        return self.policies([self], views)[0]

    @classmethod
    def policies(cls, modules: Sequence[NetworkedQModule], views: Sequence[GroupView]) -> list[Tensor]:  # type: ignore[override]
        """Return for each group the best value (M, n, A) that each own action allows, by its own network."""
        outputs = []
        for module in modules:
            table = module.combinations.masked_values(module.q(views), views)
            outputs.append(module.combinations.own_values(table, module.group))
        return outputs


class NetworkedQLearner(OffPolicyLearner):
    """Steps of a distributed fit; every `fit_steps` of them agents agree and set new targets."""

    def build(self) -> None:
        """Build modules, with nothing known of gradients yet."""
        super().build()
        self.neighbourhood = Neighbourhood(self.spec.spaces, self.config.graph)
        self.combinations = JointActions(self.groups)
        self._fitted = {group.id: self._parameters[group.id] for group in self.groups}
        size = sum(p.numel() for p in self._fitted[self.groups[0].id])
        self.gradients = torch.zeros(len(self.groups), size, device=self._device)
        self.tracked = torch.zeros_like(self.gradients)

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Take one step of the fit, and start the next iteration when it is due."""
        mixing = self.mixing(batch)
        gradients = self.local_gradients(batch)
        self.tracked = mixing @ (self.tracked + gradients - self.gradients)
        self.gradients = gradients
        for group, along in zip(self.groups, self.tracked, strict=True):
            own = torch.nn.utils.parameters_to_vector(self._fitted[group.id])
            self.step_optimizer(own @ along, group.id)
        self.average(mixing)
        if (self.updates % self.config.fit_steps) == 0:
            self.average(torch.linalg.matrix_power(mixing, self.config.agreement_rounds))
            self.polyak_update(*(group.id for group in self.groups), tau=1.0)

    def local_gradients(self, batch: ReplayBatch) -> Tensor:
        """Return each node's gradient (G, W) of its own share of the team's squared error."""
        groups = dict(batch.groups())
        views, following = list(groups.values()), [own.next for own in groups.values()]
        number = self.combinations.number([own.actions for own in groups.values()])
        goes_on, gradients = batch.bootstrap.any(-1), []
        for group, own in groups.items():
            net = self.net(group.id)
            with torch.no_grad():
                values = net.target_q(following)
                ranking = net.q(following) if self.config.double else values
                likely = self.combinations.masked_values(ranking, following).flatten(1).argmax(1)
                best = of_actions(values, likely)
                rewards = self.config.reward_scale * torch.where(own.alive, own.rewards, 0)
                targets = rewards + self.gamma * torch.where(goes_on, best, 0).unsqueeze(-1)
            error = (of_actions(net.q(views), number).unsqueeze(-1) - targets).square()
            # The mean over nodes of these losses is the mean over agents of their errors.
            mean = self.mean(error.sum(-1), torch.ones_like(goes_on))
            loss = mean * len(self.groups) / len(self.spec.agents)
            own_gradient = torch.autograd.grad(loss, self._fitted[group.id])
            gradients.append(torch.cat([g.flatten() for g in own_gradient]))
            self.log(group.id, "fit_loss", loss)
        return self.parallel.average([torch.stack(gradients)])[0]

    def mixing(self, batch: ReplayBatch) -> Tensor:
        """Return the weights (G, G) of one exchange: Metropolis' on the graph of one of the moments."""
        if not self.config.consensus:
            return torch.eye(len(self.groups), device=self._device)
        if self.neighbourhood.fixed is not None:
            return metropolis(node_links(self.neighbourhood.fixed, self.groups)).to(self._device)
        links = self.neighbourhood.of(batch[:1])[0]
        self.parallel.broadcast(links)
        return metropolis(node_links(links, self.groups))

    def average(self, mixing: Tensor) -> None:
        """Replace every node's parameters by the weighted mean of its neighbours' and its own."""
        with torch.no_grad():
            own = [torch.nn.utils.parameters_to_vector(self._fitted[g.id]) for g in self.groups]
            for group, mixed in zip(self.groups, mixing @ torch.stack(own), strict=True):
                torch.nn.utils.vector_to_parameters(mixed, self._fitted[group.id])

    def _own_state(self) -> dict[str, Any]:
        known = {"gradients": self.gradients.cpu().numpy(), "tracked": self.tracked.cpu().numpy()}
        return {**super()._own_state(), **known}

    def _set_own_state(self, state: dict[str, Any]) -> None:
        super()._set_own_state(state)
        self.gradients = torch.tensor(state["gradients"], device=self._device)
        self.tracked = torch.tensor(state["tracked"], device=self._device)


def node_links(links: Tensor, groups: Sequence[Group]) -> Tensor:
    """Group adjacency (G, G): true if any two members communicate both ways."""
    mutual, nodes = links & links.transpose(-1, -2), len(groups)
    linked = torch.zeros(nodes, nodes, dtype=torch.bool, device=links.device)
    for i, one in enumerate(groups):
        for j, other in enumerate(groups):
            linked[i, j] = i != j and mutual[one.columns][:, other.columns].any()
    return linked


class NetworkedQConfig(JointConfig):
    """RLlib config of networked fitted Q-iteration."""

    algorithm = "networked_q"
    policy_module = NetworkedQModule
    network_settings = ("duelling",)
    explores_by = "epsilon"

    def validate(self) -> None:
        """Check the settings; see `JointConfig.validate`.

        Raises:
            ValueError: Nodes are to be frozen, which exchange their parameters.
        """
        super().validate()
        if self.policies_to_train is not None:
            self._value_error(
                f"policies_to_train={self.policies_to_train!r}: {self.algorithm!r} averages the parameters "
                "of all agents, so that none can be frozen; use 'dqn'"
            )

    def check(self, spec: JointSpec) -> None:
        """Raise if the algorithm cannot handle the environment.

        Raises:
            SpaceError: Actions are not discrete or make too many combinations, an observation is an image,
                all agents share one network, or a fixed graph falls into parts, which could never agree.
        """
        super().check(spec)
        joint = prod(JointActions(spec.groups).sizes)
        if joint > self.max_joint_actions:
            raise SpaceError(
                f"{self.algorithm!r} values each of {joint} joint actions; max_joint_actions is "
                f"{self.max_joint_actions}",
                place="action space",
                remedy="raise it, use fewer agents or actions, or use 'qmix' or 'maac'",
            )
        if self.consensus and len(spec.groups) == 1 and len(spec.agents) > 1:
            raise SpaceError(
                f"all {len(spec.agents)} agents share one network, so that there is one node and nothing to "
                "agree on",
                place=f"training(sharing={self.sharing!r}) of {self.algorithm!r}",
                remedy='give each its own by sharing="none" (settings: {networked_q: {sharing: none}}), '
                "or set consensus=False",
            )
        fixed = Neighbourhood(spec.spaces, self.graph).fixed
        if not self.consensus or fixed is None:
            return
        rate = consensus_rate(metropolis(node_links(fixed, spec.groups)))
        if rate > 1 - 1e-9:
            raise SpaceError(
                "the graph falls into parts that never agree: the second-largest eigenvalue modulus is 1",
                place=f"training(graph={self.graph!r})",
                remedy="link the parts",
            )


class NetworkedQ(JointAlgorithm):
    """Networked fitted Q-iteration."""

    config_class = NetworkedQConfig
    learner_class = NetworkedQLearner
