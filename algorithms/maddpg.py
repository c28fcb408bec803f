"""Multi-agent deep deterministic policy gradient (MADDPG), for discrete and continuous actions.

Lowe et al. 2017, "Multi-Agent Actor-Critic for Mixed Cooperative-Competitive Environments". Each group has a
critic Q_i(x, a_1, ..., a_N) of all agents' observations and actions, fitted by eq. 6 with all agents' target
policies; its policy follows eq. 5, where only agent i's action comes from its policy and the others' come
from replay. Discrete actions are Gumbel-softmax samples, continuous ones tanh with noise.

Deviations: discrete actions are straight-through, hard forwards and soft backwards, in policies and target
policies, where the authors' code takes soft samples; finished agents count as zeros in x and a, with flags of
which agents are active; agents of a group share networks, told apart by a learned bias.
"""

from __future__ import annotations

import numpy as np
import torch
from gymnasium.spaces import Discrete
from torch import Generator, Tensor, nn

from algorithms.errors import SpaceError
from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, JointView, ReplayBatch
from algorithms.joint.checks import check_bounds
from algorithms.joint.config import JointConfig
from algorithms.joint.joint_encoder import JointEncoder
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import JointModule, LearnerModule, critic_of
from algorithms.joint.spec import Group, JointSpec, action_size
from algorithms.parts.distributions import CategoricalHead, DeterministicHead, Head
from algorithms.parts.networks import Encoder, outputs_where, perceptron
from algorithms.parts.relaxation import straight_through_gumbel


class ObservationNetwork(nn.Module):
    """Outputs (..., n, P) of a group's observation leaves."""

    def __init__(self, group: Group, hidden: tuple[int, ...], outputs: int) -> None:
        super().__init__()
        self.encoder = Encoder(group.observation, group.places, group.set_width)
        self.body = perceptron([self.encoder.size, *hidden, outputs], nn.ReLU)

    def forward(self, leaves) -> Tensor:
        """Return the outputs."""
        return self.body(self.encoder(leaves))

    def of_active(self, view: GroupView) -> Tensor:
        """Return outputs (M, n, P), zeros for inactive agents."""
        return outputs_where(view.alive, self.encoder, self.body, view.observations)


class ActorModule(JointModule):
    """A policy and its target."""

    targets = ("target_actor",)

    def make_networks(self) -> None:
        """Create the policy."""
        self.actor = ObservationNetwork(self.group, self.settings["hidden"], self.head.outputs)

    def policy(self, view: GroupView) -> Tensor:
        """Return logits, or actions before tanh, (M, n, P)."""
        return self.actor(view.observations)

    def feedforward_parts(self) -> tuple[Encoder, nn.Module]:
        """Return encoder and body, for stacked acting."""
        return self.actor.encoder, self.actor.body


class MADDPGModule(ActorModule):
    """A policy and its target, with samples that gradients flow through."""

    def make_head(self) -> Head:
        """Sample discrete actions; continuous ones are deterministic with noise."""
        space = self.group.action
        return CategoricalHead(space) if isinstance(space, Discrete) else DeterministicHead(space)

    def relax(self, outputs: Tensor, view: GroupView, generator: Generator) -> Tensor:
        """Return actions (M, n, A) as critics see them, with gradient; zeros for the absent."""
        if isinstance(self.head, CategoricalHead):
            actions = straight_through_gumbel(outputs, view.action_mask, generator)
        else:
            actions = outputs.tanh()
        return actions * view.alive[..., None]


class JointQ(nn.Module):
    """Q_i(x, a) for the n agents of a group.

    The first layer is linear in every agent's action, so replacing one agent's action costs one small product
    instead of a pass over the joint input for each agent. Without hidden layers all of Q is linear.
    """

    def __init__(self, spec: JointSpec, group: Group, hidden: tuple[int, ...]) -> None:
        super().__init__()
        widths = {g.id: (g.size, action_size(g.action)) for g in spec.groups}
        start = 0
        for g in spec.groups:
            if g.id == group.id:
                break
            start += int(np.prod(widths[g.id]))
        self._own = slice(start, start + int(np.prod(widths[group.id])))
        self._shape = widths[group.id]
        total = sum(int(np.prod(w)) for w in widths.values())
        first, *others = *hidden, 1
        self.encoder = JointEncoder(spec, state=False)
        self.see = nn.Linear(self.encoder.size, first)
        self.act = nn.Linear(total, first, bias=False)
        self.place = nn.Parameter(torch.randn(group.size, first) * 0.1)
        self.rest = nn.Sequential()
        if others:
            self.rest = nn.Sequential(nn.ReLU(), *perceptron([first, *others], nn.ReLU))

    def forward(
        self,
        view: JointView,
        actions: dict[str, Tensor],
        replaced: Tensor | None = None,
        chosen: Tensor | None = None,
    ) -> Tensor:
        """Return Q values (M, n) of chosen agents, and zeros for others, uncomputed.

        Args:
            view: What all agents see.
            actions: All agents' actions by group id, each (M, n, A).
            replaced: Own actions (M, n, A): row i takes these for agent i, and `actions` for all others.
            chosen: Own agents (M, n) whose values count; None: all.
        """
        flat = torch.cat([actions[g.id].flatten(1) for g in view.spec.groups], -1)
        first = (self.see(self.encoder(view)) + self.act(flat)).unsqueeze(1) + self.place
        if replaced is not None:
            agents, width = self._shape
            weight = self.act.weight[:, self._own].T.reshape(agents, width, -1)
            change = replaced - flat[:, self._own].reshape(-1, agents, width)
            first = first + torch.einsum("mna,nah->mnh", change, weight)
        if chosen is None or chosen.all():
            return self.rest(first).squeeze(-1)
        rows = chosen.flatten().nonzero().squeeze(-1)
        values = self.rest(first.flatten(0, 1).index_select(0, rows)).squeeze(-1)
        return values.new_zeros(chosen.numel()).index_copy(0, rows, values).unflatten(0, chosen.shape)


class MADDPGCritic(LearnerModule):
    """A group's critic and its target."""

    targets, joins = ("target_q",), "observations"

    def make_networks(self) -> None:
        """Create the critic."""
        self.q = JointQ(self.spec, self.group, self.settings["hidden"])


class MADDPGLearner(OffPolicyLearner):
    """Critic steps for all groups, then policy steps for all groups, then targets."""

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Take the steps of one minibatch."""
        taken = batch.encoded_actions()
        self.fit_critics(batch, taken)
        self.improve_policies(batch, taken)
        self.polyak_update(*self.module.keys(), tau=self.config.tau)

    def fit_critics(self, batch: ReplayBatch, taken: dict[str, Tensor]) -> None:
        """Regress Q_i(x, a) on r_i + gamma Q'_i(x', a'), a' from the target policies (eq. 6)."""
        following = batch.next
        with torch.no_grad():
            acts = {}
            for group in self.groups:
                net, view = self.net(group.id), following.view(group)
                acts[group.id] = net.relax(net.target_actor.of_active(view), view, self.generator)
        losses = {}
        for group, own in batch.present():
            critic = self.net(critic_of(group))
            with torch.no_grad():
                target = self.td_target(own, critic.target_q(following, acts, chosen=own.bootstrap))
            losses[critic_of(group)] = self.mean(
                (critic.q(batch, taken, chosen=own.alive) - target).square(), own.alive
            )
            self.log(group.id, "critic_loss", losses[critic_of(group)])
        self.step_each(losses)

    def improve_policies(self, batch: ReplayBatch, taken: dict[str, Tensor]) -> None:
        """Follow the gradient of Q_i(x, a_1, .., pi_i(o_i), .., a_N) in agent i's own action only (eq. 5)."""
        losses = {}
        for group, own in batch.present():
            net = self.net(group.id)
            outputs = net.actor.of_active(own)
            actions = net.relax(outputs, own, self.generator)
            values = self.net(critic_of(group)).q(batch, taken, actions, own.alive)
            size = outputs.square() if own.action_mask is None else outputs.square() * own.action_mask
            penalty = self.config.logit_penalty * self.mean(size.mean(-1), own.alive)
            q = self.mean(values, own.alive)
            losses[group.id] = penalty - q
            self.log(group.id, "policy_loss", -q)
        self.step_each(losses)


class MADDPGConfig(JointConfig):
    """RLlib config of MADDPG."""

    algorithm = "maddpg"
    policy_module, critic_module = MADDPGModule, MADDPGCritic
    explores_by = "noise"

    def check(self, spec: JointSpec) -> None:
        """Raise if the algorithm cannot handle the environment; see `JointConfig.check`.

        Raises:
            SpaceError: Actions have no bounds, or there is noise on continuous actions, but no agent has any.
        """
        super().check(spec)
        check_bounds(spec, self.algorithm)
        default = self.entry.settings.model_fields["noise"].default
        if self.noise != default and all(isinstance(b.action, Discrete) for b in spec.spaces.blocks):
            raise SpaceError(
                f"noise={self.noise!r} changes nothing: all actions are discrete, and sampled",
                place="training(noise=...)",
                remedy="leave it out",
            )


class MADDPG(JointAlgorithm):
    """MADDPG."""

    config_class = MADDPGConfig
    learner_class = MADDPGLearner
