"""QTRAN: an unrestricted team value, and a sum of the agents' values that has the same best joint action.

Son et al. 2019, "QTRAN: Learning to Factorize with Transformation for Cooperative Multi-Agent Reinforcement
Learning". Q_jt(s, u) is any function of state and joint action, fitted by its temporal difference, where the
next joint action consists of the agents' own best ones. The agents' values Q_i satisfy theorem 1 (eq. 4),

    D(s, u) = sum of Q_i(o_i, u_i) - Q_jt(s, u) + V_jt(s)   is 0 at the agents' best actions, >= 0 elsewhere,

so that their best actions are the team's. "base" penalises (D at the best actions)^2 and min(D, 0)^2 at
the actions taken. "alt" strengthens the second condition (theorem 2): for each agent, the smallest D over its
own actions, the others' as taken, is 0. It takes Q_jt(s, ., u_-i) from COMA's counterfactual network, and has
the losses of "base" for each agent's output. No gradient of the constraints reaches Q_jt.

The constraints of both are those of the authors' code (Sonkyunghwan/QTRAN: "pqmix7" is base, "pqmix5" alt),
where D has no V_jt, since its agents see the whole state; both weights are 1 there, as here.

Deviations: Q_jt and V_jt read the global state instead of sums of the agents' hidden features (the code:
their mean); double Q-learning and duelling values as `dqn` (`double=False`: the paper's targets); in "base"
targets bootstrap from Q'_jt, as in the paper, where the code takes the sum of the agents' largest Q'_i; in
"alt" from the mean of the active agents' outputs, where the code takes the largest output over agents and own
actions, the others' at their best; the team's reward is the sum (or mean, `team_reward`) over the active
agents, and inactive agents contribute zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor, nn

from algorithms.coma import CounterfactualQ
from algorithms.dqn import best_actions
from algorithms.joint.batch import JointView, ReplayBatch, encode
from algorithms.joint.joint_encoder import JointEncoder
from algorithms.joint.module import LearnerModule
from algorithms.joint.spec import JointSpec, action_size
from algorithms.parts.masking import masked_mean_of_agents
from algorithms.parts.networks import perceptron
from algorithms.vdn import VDN, VDNConfig, VDNLearner

JOINT = "team__joint"
FORBIDDEN = 1e9
"""Value that no minimum takes."""
Actions = Mapping[str, Tensor]
"""Actions by group id, one-hot (M, n, A), zeros for inactive agents."""


class TeamQ(nn.Module):
    """Q_jt(s, u), (M, 1)."""

    def __init__(self, spec: JointSpec, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self._groups = spec.groups
        actions = sum(group.size * action_size(group.action) for group in spec.groups)
        self.encoder = JointEncoder(spec)
        self.body = perceptron([self.encoder.size + actions, *hidden, 1], nn.ReLU)

    def forward(self, view: JointView, actions: Actions) -> Tensor:
        """Return the values."""
        flat = [actions[group.id].flatten(1) for group in self._groups]
        return self.body(torch.cat([self.encoder(view), *flat], -1))


class QTRANJoint(LearnerModule):
    """The joint value with its target, and V_jt(s)."""

    targets, joins = ("target_q",), "state"

    def make_networks(self) -> None:
        """Create all networks."""
        hidden = self.settings["hidden"]
        kind = TeamQ if self.settings["variant"] == "base" else CounterfactualQ
        self.q = kind(self.spec, hidden)
        self.encoder = JointEncoder(self.spec)
        self.v = perceptron([self.encoder.size, *hidden, 1], nn.ReLU)


class QTRANLearner(VDNLearner):
    """One step of all networks on the temporal difference and both constraints.

    A joint value has an estimate (M, 1) in "base", and one of each agent (M, N) in "alt".
    """

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Step all networks together."""
        net, there = self.net(JOINT), self.estimating(batch)
        values, best, taken = self.own_values(batch), {}, batch.encoded_actions()
        for group, own in batch.groups():
            best[group.id] = encode(group, best_actions(values[group.id], own)) * own.alive[..., None]
        joint, at_best = net.q(batch, taken), net.q(batch, best)
        v, total = net.v(net.encoder(batch)), total_of(values, taken)
        estimate = self.estimates(batch, joint, taken)
        td = (estimate - self.targets(batch)[:, None]).square()
        opt = (total_of(values, best) - self.estimates(batch, at_best, best).detach() + v).square()
        if self.config.variant == "base":
            nopt = (total - joint.detach() + v).clamp(max=0).square()
        else:
            nopt = self.smallest_gaps(batch, values, taken, joint, v).square()
        parts = {"td_loss": td, "opt_loss": opt, "nopt_loss": nopt}
        means = {name: self.mean(part.expand_as(there), there) for name, part in parts.items()}
        loss = means["td_loss"] + self.config.lambda_opt * means["opt_loss"]
        loss = loss + self.config.lambda_nopt * means["nopt_loss"]
        self.step_optimizer(loss, *(name for name in self.trained() if name not in batch.absent))
        for name, mean in means.items():
            self.log(JOINT, name, mean)
        self.polyak_update(*self.trained(), tau=self.config.tau)

    def own_values(self, batch: ReplayBatch) -> dict[str, Tensor]:
        """Return Q_i(o_i, .) (M, n, A) by group id, zeros for inactive agents."""
        return {g.id: self.net(g.id).policy(own) * own.alive[..., None] for g, own in batch.groups()}

    def estimating(self, view: JointView) -> Tensor:
        """Return which estimates of joint values count, (M, 1) or (M, N)."""
        return view.alive.any(-1, keepdim=True) if self.config.variant == "base" else view.alive

    def estimates(self, view: JointView, joint: Tensor | Actions, actions: Actions) -> Tensor:
        """Return the estimates of Q_jt(s, u), of what the network returned for the joint actions."""
        if isinstance(joint, Tensor):
            return joint
        return view.join({name: (joint[name] * actions[name]).sum(-1) for name in joint})

    @torch.no_grad()
    def targets(self, batch: ReplayBatch) -> Tensor:
        """Return r + gamma Q'_jt(s', u') (M,), u' the agents' best next actions."""
        following, chosen = batch.next, {}
        for group, own in batch.groups():
            net = self.net(group.id)
            view, target_view = self.following(net, own)
            ranking = net.policy(view) if self.config.double else net.target_q(target_view.observations)
            chosen[group.id] = encode(group, best_actions(ranking, view)) * view.alive[..., None]
        joint = self.net(JOINT).target_q(following, chosen)
        value = masked_mean_of_agents(self.estimates(following, joint, chosen), self.estimating(following))
        return self.reward(batch) + self.gamma * value

    def smallest_gaps(
        self, batch: ReplayBatch, values: Actions, taken: Actions, joint: Actions, v: Tensor
    ) -> Tensor:
        """Return for each agent the smallest D(s, (u_-i, .)) over its allowed actions, (M, N)."""
        total, gaps = total_of(values, taken), {}
        for group, own in batch.groups():
            mine = (values[group.id] * taken[group.id]).sum(-1, keepdim=True)
            others = (total + v)[:, None] - mine
            gap = values[group.id] + others - joint[group.id].detach()
            if own.action_mask is not None:
                gap = gap.masked_fill(~own.action_mask, FORBIDDEN)
            gaps[group.id] = gap.amin(-1)
        return batch.join(gaps)

    def trained(self) -> tuple[str, ...]:
        """Return the networks that the loss steps."""
        return (*super().trained(), JOINT)


def total_of(values: Actions, actions: Actions) -> Tensor:
    """Return the sum of Q_i(o_i, u_i) over agents, (M, 1)."""
    parts = [(values[name] * actions[name]).sum((-1, -2)) for name in values]
    return torch.stack(parts).sum(0)[:, None]


class QTRANConfig(VDNConfig):
    """RLlib config of QTRAN."""

    algorithm = "qtran"
    team_modules: ClassVar = {JOINT: QTRANJoint}
    network_settings = (*VDNConfig.network_settings, "variant")


class QTRAN(VDN):
    """QTRAN."""

    config_class = QTRANConfig
    learner_class = QTRANLearner
