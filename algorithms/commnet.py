"""CommNet: agents that broadcast hidden layers to each other when they act.

Sukhbaatar, Szlam & Fergus 2016, "Learning Multiagent Communication with Backpropagation". Every agent
encodes its observation, then K times hears the mean of the other active agents' hidden layers (eq. 2) and
computes its next hidden layer (eq. 1), in the paper's simple form h <- tanh(H^i h + C^i c). The gradient is
the paper's: policy gradient with a learned baseline as a second output of the same network, its error
weighted by `value_coeff` (the paper's alpha = 0.03), through all agents' messages.

The first encoder layers are the paper's r and f^0, for which c^0 = 0; the K layers after them hear. Agents
carry no number of their place, so that the network of a group is permutation equivariant as in the paper:
agents that see the same do the same.

Deviations: one step on each rollout with generalised advantages instead of returns of whole episodes;
standardised advantages; an entropy bonus; Adam instead of RMSProp. With `epochs` or `minibatch_size` the
steps are PPO's, since one step on a rollout learns little from it. Each agent's gain is of its own rewards;
the paper's agents share one. Groups may have networks of their own, which hear each other; the paper's agents
share one network. The paper's extensions are left out: local connectivity, skip connections, recurrence.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from algorithms.a2c import A2C, A2CConfig, A2CLearner
from algorithms.joint.batch import GroupView, JointView, OnPolicyBatch
from algorithms.joint.module import JointModule
from algorithms.parts.communication import mean_of_others
from algorithms.parts.moments import RunningMoments
from algorithms.parts.networks import Encoder, orthogonal, perceptron
from algorithms.ppo import clipped_surrogate


class CommNetModule(JointModule):
    """A group's encoder, hearing layers, policy output and baseline."""

    communicates = True

    def make_networks(self) -> None:
        """Create all layers."""
        widths, hops = self.settings["hidden"], range(self.settings["communication_steps"])
        width, gain = widths[-1], nn.init.calculate_gain("tanh")
        self.encoder = Encoder(self.group.observation, set_width=self.group.set_width)
        first = orthogonal(perceptron([self.encoder.size, *widths]), gain=gain, last=gain)
        self.first = nn.Sequential(*first, nn.Tanh())
        self.keep = nn.ModuleList(nn.Linear(width, width) for _ in hops)
        self.hear = nn.ModuleList(nn.Linear(width, width, bias=False) for _ in hops)
        self.decoder = orthogonal(perceptron([width, self.head.outputs]), gain=1, last=0.01)
        self.baseline = orthogonal(perceptron([width, 1]), gain=1, last=1)
        self.moments = RunningMoments(enabled=self.settings["normalize_values"])

    @classmethod
    def converse(cls, modules: Sequence[CommNetModule], views: Sequence[GroupView]) -> list[Tensor]:
        """Return every group's last hidden layer (M, n, H), after all agents of all groups have talked."""
        hidden = [m.first(m.encoder(v.observations)) for m, v in zip(modules, views, strict=True)]
        alive = torch.cat([view.alive for view in views], -1)
        sizes = [view.alive.shape[-1] for view in views]
        for hop in range(modules[0].settings["communication_steps"]):
            heard = mean_of_others(torch.cat(hidden, -2), alive).split(sizes, -2)
            hidden = [m.listen(hop, h, c) for m, h, c in zip(modules, hidden, heard, strict=True)]
        return hidden

    def listen(self, hop: int, hidden: Tensor, heard: Tensor) -> Tensor:
        """Return the next hidden layer (eq. 1); without a channel the agents hear nothing."""
        total = self.keep[hop](hidden)
        return (total + self.hear[hop](heard) if self.settings["channel"] else total).tanh()

    def policy(self, view: GroupView) -> Tensor:
        """Return the outputs of a group that is alone."""
        return self.policies([self], [view])[0]

    @classmethod
    def policies(cls, modules: Sequence[CommNetModule], views: Sequence[GroupView]) -> list[Tensor]:  # type: ignore[override]
        """Return every group's outputs (M, n, P)."""
        hidden = cls.converse(modules, views)
        return [module.decoder(h) for module, h in zip(modules, hidden, strict=True)]

    def value(self, hidden: Tensor) -> Tensor:
        """Return scaled values (M, n) of last hidden layers (M, n, H)."""
        return self.baseline(hidden).squeeze(-1)

    def get_non_inference_attributes(self) -> list[str]:
        """Return the attributes that runners do not hold (RLlib)."""
        return ["baseline", "moments"]


class CommNetLearner(A2CLearner):
    """One actor-critic step on all networks at once, since every message matters to every hearer."""

    def nets(self) -> list[CommNetModule]:
        """Return the networks in the order of the groups."""
        return [self.net(group.id) for group in self.groups]

    def values(self, view: JointView) -> Tensor:
        """Return each agent's value of what it saw and heard, (M, N)."""
        nets, values = self.nets(), {}
        hidden = CommNetModule.converse(nets, [view.view(group) for group in self.groups])
        for group, net, last in zip(self.groups, nets, hidden, strict=True):
            values[group.id] = net.moments.unscaled(net.value(last))
        return view.join(values)

    def observe_targets(self, batch: OnPolicyBatch) -> None:
        """Adapt the scale of every baseline."""
        for group, own in batch.groups():
            if group.id not in self.frozen:
                self.net(group.id).moments.observe(own.targets, own.alive)

    def policy_loss(self, log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor) -> Tensor:
        """Return the loss of each action: the policy gradient's, or PPO's for several steps on a rollout."""
        if self.config.epochs == 1 and self.config.minibatch_size is None:
            return super().policy_loss(log_prob, old_log_prob, advantages)
        return clipped_surrogate(log_prob, old_log_prob, advantages, self.config.clip)

    def update_minibatch(self, batch: OnPolicyBatch) -> None:
        """Take one step on the sum over groups of policy, baseline and entropy losses."""
        nets, groups = self.nets(), [own for _, own in batch.groups()]
        total = torch.zeros((), device=batch.alive.device)
        for net, own, hidden in zip(nets, groups, CommNetModule.converse(nets, groups), strict=True):
            policy = net.head.distribution(net.decoder(hidden), own.action_mask)  # type: ignore[attr-defined]
            log_prob = torch.where(own.alive, policy.log_prob(own.actions), own.log_prob)
            loss = self.policy_loss(log_prob, own.log_prob, own.advantages)
            error = (net.value(hidden) - net.moments.scaled(own.targets)).square()
            entropy = self.mean(policy.entropy(), own.alive)
            fit = self.mean(error, own.alive)
            mean_loss = self.mean(loss, own.alive)
            total = total + mean_loss + self.config.value_coeff * fit
            total = total - self.schedule_value(self.config.entropy_coeff) * entropy
            self.log(net.group.id, "policy_loss", mean_loss)
            self.log(net.group.id, "entropy", entropy)
            self.log(net.group.id, "value_loss", fit)
        self.step_optimizer(total, *(group.id for group in self.groups if group.id not in batch.absent))


class CommNetConfig(A2CConfig):
    """RLlib config of CommNet."""

    algorithm = "commnet"
    policy_module, critic_module = CommNetModule, None
    network_settings = (*A2CConfig.network_settings, "communication_steps", "channel")
    interchangeable = ("channel",)


class CommNet(A2C):
    """CommNet."""

    config_class = CommNetConfig
    learner_class = CommNetLearner
