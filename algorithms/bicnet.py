"""Bidirectionally-coordinated nets (BiCNet): policies and critics that are recurrent over the agents.

Peng et al. 2017, "Multiagent Bidirectionally-Coordinated Nets: Emergence of Human-level Coordination in
Learning to Play StarCraft Combat Games" (arXiv:1703.10069). Policies and critics are bidirectional recurrent
networks whose steps are the agents in their order, so that every agent's action depends on what all agents
see, and every value Q_i on all observations and actions. Learned from replay by the paper's multiagent
deterministic policy gradient,

    grad J = E[sum over i and j of grad_theta a_j(s) grad_{a_j} Q_i(s, a)],

and by the critics' temporal differences r_i + gamma Q'_i(s', a'(s')) - Q_i(s, a), with own rewards. Policies
and critics have targets.

The paper could not be read: the gradient is that of lecture notes by one of its authors, and both steps are
those of later code of his (ying-wen/malib_deprecated). No code of the paper's experiments was found.

Deviations: discrete actions are straight-through Gumbel-softmax samples with a penalty on outputs, as in
`maddpg`; the recurrent cells are plain tanh units (that code: LSTMs, in the critic only, beside policies that
do not communicate); the critics' errors are squared (that code: Huber's loss); noise is independent from step
to step (that code: an Ornstein-Uhlenbeck process); inactive agents are skipped by both directions; groups may
have networks of their own, which hand on to each other; the paper's agents share one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, JointView, ReplayBatch
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import LearnerModule, critic_of
from algorithms.joint.spec import Group, action_size
from algorithms.maddpg import MADDPGConfig, MADDPGModule
from algorithms.parts.networks import Encoder, perceptron


class BidirectionalNet(nn.Module):
    """A group's part of a bidirectional network over all agents.

    Args:
        group: The agents.
        hidden: Widths of the layers before; the last is the width H of what is handed on.
        beside: Numbers that enter beside the observation.
        outputs: Numbers that come out for each agent.
    """

    def __init__(self, group: Group, hidden: Sequence[int], beside: int, outputs: int) -> None:
        super().__init__()
        self.encoder = Encoder(group.observation, set_width=group.set_width)
        self.enter = nn.Sequential(*perceptron([self.encoder.size + beside, *hidden], nn.ReLU), nn.ReLU())
        self.width = hidden[-1]
        self.rightward = nn.RNNCell(self.width, self.width)
        self.leftward = nn.RNNCell(self.width, self.width)
        self.leave = nn.Linear(2 * self.width, outputs)

    def features(self, view: GroupView, beside: Tensor | None) -> Tensor:
        """Return what enters the recurrent cells, (M, n, H)."""
        seen = self.encoder(view.observations)
        return self.enter(seen if beside is None else torch.cat([seen, beside], -1))


def coordinate(
    nets: Sequence[BidirectionalNet],
    groups: Sequence[Group],
    views: Sequence[GroupView],
    beside: Sequence[Tensor] | None = None,
) -> list[Tensor]:
    """Return every group's outputs (M, n, P), after both directions have passed all agents.

    Args:
        nets: The networks of some groups.
        groups: These groups.
        views: What their agents see.
        beside: What enters beside the observations, (M, n, k).
    """
    extras = beside or [None] * len(nets)
    features = [net.features(view, own) for net, view, own in zip(nets, views, extras, strict=True)]
    chain = sorted(
        (column, k, place) for k, group in enumerate(groups) for place, column in enumerate(_columns(group))
    )
    right = _hand_on([(k, place, nets[k].rightward) for _, k, place in chain], features, views)
    left = _hand_on([(k, place, nets[k].leftward) for _, k, place in reversed(chain)], features, views)
    return [net.leave(torch.cat(both, -1)) for net, *both in zip(nets, right, left, strict=True)]


def _columns(group: Group) -> list[int]:
    columns = group.columns
    return list(range(columns.start, columns.stop)) if isinstance(columns, slice) else columns.tolist()


def _hand_on(
    chain: Sequence[tuple[int, int, nn.RNNCell]], features: Sequence[Tensor], views: Sequence[GroupView]
) -> list[Tensor]:
    """Return the recurrent states (M, n, H) of each group's agents; inactive ones hand on what they got."""
    state = torch.zeros_like(features[0][:, 0])
    states: list[dict[int, Tensor]] = [{} for _ in features]
    for k, place, cell in chain:
        heard = cell(features[k][:, place], state)
        state = torch.where(views[k].alive[:, place, None], heard, state)
        states[k][place] = state
    return [torch.stack([own[place] for place in sorted(own)], 1) for own in states]


class BiCNetModule(MADDPGModule):
    """A group's policy network and its target."""

    communicates = True

    def make_networks(self) -> None:
        """Create the policy."""
        self.actor = BidirectionalNet(self.group, self.settings["hidden"], 0, self.head.outputs)

    def policy(self, view: GroupView) -> Tensor:
        """Return the outputs of a group that is alone."""
        return self.policies([self], [view])[0]

    @classmethod
    def policies(cls, modules: Sequence[BiCNetModule], views: Sequence[GroupView]) -> list[Tensor]:  # type: ignore[override]
        """Return every group's outputs (M, n, P)."""
        return coordinate([module.actor for module in modules], [module.group for module in modules], views)


class BiCNetCritic(LearnerModule):
    """A group's part of the critic, and its target."""

    targets = ("target_q",)

    def make_networks(self) -> None:
        """Create the critic."""
        self.q = BidirectionalNet(self.group, self.settings["hidden"], action_size(self.group.action), 1)


class BiCNetLearner(OffPolicyLearner):
    """A step of all critics, a step of all policies, then targets."""

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Take the steps of one minibatch."""
        present = [group for group, _ in batch.present()]
        self.fit_critics(batch, present)
        self.improve_policies(batch, present)
        self.polyak_update(*self.module.keys(), tau=self.config.tau)

    def fit_critics(self, batch: ReplayBatch, present: Sequence[Group]) -> None:
        """Regress all Q_i(s, a) on r_i + gamma Q'_i(s', a'), a' from the target policies."""
        following = batch.next
        with torch.no_grad():
            chosen = self.relaxed(following, self.outputs(following, "target_actor"))
            target = self.td_target(batch, self.values(following, chosen, "target_q"))
        loss = self.mean((self.values(batch, batch.encoded_actions(), "q") - target).square(), batch.alive)
        self.step_optimizer(loss, *(critic_of(group) for group in present))
        for group in present:
            self.log(group.id, "critic_loss", loss)

    def improve_policies(self, batch: ReplayBatch, present: Sequence[Group]) -> None:
        """Follow the gradient of the sum of all Q_i(s, a(s)) in all agents' actions."""
        outputs = self.outputs(batch, "actor")
        q = self.mean(self.values(batch, self.relaxed(batch, outputs), "q"), batch.alive)
        sizes = {}
        for group, own in batch.groups():
            size = outputs[group.id].square()
            sizes[group.id] = (size if own.action_mask is None else size * own.action_mask).mean(-1)
        penalty = self.config.logit_penalty * self.mean(batch.join(sizes), batch.alive)
        self.step_optimizer(penalty - q, *(group.id for group in present))
        for group in present:
            self.log(group.id, "policy_loss", -q)

    def outputs(self, view: JointView, actor: str) -> dict[str, Tensor]:
        """Return all policies' or target policies' outputs (M, n, P) by group id."""
        nets = [getattr(self.net(group.id), actor) for group in self.groups]
        outputs = coordinate(nets, self.groups, [view.view(group) for group in self.groups])
        return {group.id: own for group, own in zip(self.groups, outputs, strict=True)}

    def relaxed(self, view: JointView, outputs: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return actions (M, n, A) as critics see them by group id, with gradient."""
        return {g.id: self.net(g.id).relax(outputs[g.id], view.view(g), self.generator) for g in self.groups}

    def values(self, view: JointView, actions: Mapping[str, Tensor], critic: str) -> Tensor:
        """Return all agents' values Q_i(s, a), (M, N)."""
        nets = [getattr(self.net(critic_of(group)), critic) for group in self.groups]
        views, beside = [view.view(g) for g in self.groups], [actions[g.id] for g in self.groups]
        values = coordinate(nets, self.groups, views, beside)
        return view.join({g.id: own.squeeze(-1) for g, own in zip(self.groups, values, strict=True)})


class BiCNetConfig(MADDPGConfig):
    """RLlib config of BiCNet."""

    algorithm = "bicnet"
    policy_module, critic_module = BiCNetModule, BiCNetCritic


class BiCNet(JointAlgorithm):
    """BiCNet."""

    config_class = BiCNetConfig
    learner_class = BiCNetLearner
