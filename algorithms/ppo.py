"""Independent proximal policy optimisation (PPO).

Every group of agents learns as if the others were part of its environment. Schulman et al. 2017, "Proximal
Policy Optimization Algorithms": the clipped surrogate of eq. 7, advantages by eq. 11-12 (generalised
advantage estimation, Schulman et al. 2016). De Witt et al. 2020 show how far this goes with several agents.

Deviations: policy and value function are separate networks with separate optimisers, so there is no weight
between their losses; advantages are standardised per policy network over the whole rollout, not per
minibatch; the value loss is not clipped. With `gru`, policies are recurrent and learn by truncated
backpropagation through sequences that begin with the stored memory (Kapturowski et al. 2019); critics have no
recurrence of their own but read the policies' stored memory beside the observation.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import torch
from torch import Tensor, nn

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, JointView, OnPolicyBatch
from algorithms.joint.config import JointConfig
from algorithms.joint.learner import OnPolicyLearner
from algorithms.joint.module import LearnerModule, critic_of
from algorithms.joint.reference import ReferencePolicy
from algorithms.joint.rollout import JointRollout
from algorithms.joint.spec import Group
from algorithms.joint.stacking import Plain, StackedGroups, stack_groups
from algorithms.parts.moments import RunningMoments
from algorithms.parts.networks import Encoder, orthogonal, outputs_where, perceptron


class LocalValue(LearnerModule):
    """V(o_i) from an agent's own observation."""

    def make_networks(self) -> None:
        """Create encoder and body."""
        self.encoder = Encoder(self.group.observation, self.group.places, self.group.set_width)
        self.moments = RunningMoments(enabled=self.settings["normalize_values"])
        self.body = orthogonal(
            perceptron([self.encoder.size, *self.settings["hidden"], 1]), gain=np.sqrt(2), last=1
        )

    def value(self, view: GroupView) -> Tensor:
        """Return scaled values (M, n)."""
        return self.body(self.encoder(view.observations)).squeeze(-1)

    def feedforward_parts(self) -> tuple[Encoder, nn.Module]:
        """Return encoder and body, for stacked evaluation."""
        return self.encoder, self.body


def clipped_surrogate(log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor, clip: float) -> Tensor:
    """Return the loss of each action, minus eq. 7 of Schulman et al. 2017."""
    ratio = torch.exp(log_prob - old_log_prob)
    return -torch.minimum(ratio * advantages, ratio.clamp(1 - clip, 1 + clip) * advantages)


class PPOLearner(OnPolicyLearner):
    """Clipped policy steps and value regression, group by group."""

    def build(self) -> None:
        """Build modules, and find groups whose networks can be evaluated as one."""
        super().build()
        self.stacked_policies = stack_groups(self.groups, self._plain_policy)
        self.stacked_values = stack_groups(self.groups, self._plain_value)

    @cached_property
    def reference(self) -> ReferencePolicy | None:
        """The policy that the learned one keeps near to; read by the first step, as tests need none."""
        if self.config.kl_to is None:
            return None
        learning = {group.id: self.net(group.id) for group in self.groups}
        return ReferencePolicy(self.config.kl_to, learning, self._device)

    def values(self, view: JointView) -> Tensor:
        """Return each agent's value of its own observation, (M, N)."""
        values = {}
        for stack in self.stacked_values:
            columns = self._scaled_values(stack, view.view(stack.whole)).split(
                [g.size for g in stack.groups], -1
            )
            for group, scaled in zip(stack.groups, columns, strict=True):
                values[group.id] = self.net(critic_of(group)).moments.unscaled(scaled)
        return view.join(values)

    def prepare(self, rollout: JointRollout) -> OnPolicyBatch:
        """Return the batch; critics see its targets once, to adapt their scale."""
        batch = super().prepare(rollout)
        self.observe_targets(batch)
        return batch

    def observe_targets(self, batch: OnPolicyBatch) -> None:
        """Adapt the scale of every critic."""
        for group, own in batch.groups():
            if critic_of(group) not in self.frozen:
                self.net(critic_of(group)).moments.observe(own.targets, own.alive)

    def update_minibatch(self, batch: OnPolicyBatch) -> None:
        """Step every policy, then every value function."""
        self.step_policies(batch, self.stacked_policies)
        self.fit_values(batch)

    def step_policies(self, batch: OnPolicyBatch, stacks: tuple[StackedGroups, ...]) -> None:
        """Take one step of the policies of these groups."""
        losses, stepped = [], []
        for stack in stacks:
            own = batch.part(stack.whole)
            count = self.parallel.count(stack.counts(own.alive))
            head = self.net(stack.groups[0].id).head
            outputs = self._outputs(stack, own, self._plain_policy, self.net(stack.groups[0].id).policy)
            policy = head.distribution(outputs, own.action_mask)
            # The ratio of inactive agents may overflow, and masking it afterwards leaves NaN as its gradient.
            log_prob = torch.where(own.alive, policy.log_prob(own.actions), own.log_prob)
            loss = self.policy_loss(log_prob, own.log_prob, own.advantages)
            entropy, weight = policy.entropy(), self.schedule_value(self.config.entropy_coeff)
            reports = {"policy_loss": loss, "entropy": entropy, **self.change(log_prob, own.log_prob)}
            loss = loss - weight * entropy
            nearness = self.schedule_value(self.config.kl_coeff)
            if self.reference is not None and nearness:
                views = {group.id: batch.part(group) for group in stack.groups}
                away = policy.divergence(self.reference.distribution(stack.groups, views, head))
                loss = loss + nearness * torch.where(own.alive, away, 0)
                reports["kl_to_reference"] = away
            losses.append((stack.sums(loss, own.alive) / count).sum())
            present = stack.present(batch.absent)
            stepped += [group.id for group in present]
            for name, each in reports.items():
                self._log_present(stack, present, name, stack.sums(each.detach(), own.alive) / count)
        if stepped:
            self.step_optimizer(torch.stack(losses).sum(), *stepped)

    def policy_loss(self, log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor) -> Tensor:
        """Return the loss of each action."""
        return clipped_surrogate(log_prob, old_log_prob, advantages, self.config.clip)

    def change(self, log_prob: Tensor, old_log_prob: Tensor) -> dict[str, Tensor]:
        """Return how far each action's policy is from the one that acted: divergence, and whether clipped.

        The divergence is the estimate r - 1 - log r of the ratio r (Schulman 2020, "Approximating KL
        Divergence"), which is never negative.
        """
        with torch.no_grad():
            log_ratio = log_prob - old_log_prob
            change = log_ratio.expm1()
            clipped = (change.abs() > self.config.clip).float()
            return {"kl": change - log_ratio, "clip_fraction": clipped}

    def fit_values(self, batch: OnPolicyBatch) -> None:
        """Regress values on their targets."""
        losses, stepped = [], []
        for stack in self.stacked_values:
            own = batch.part(stack.whole)
            targets = own.targets.split([group.size for group in stack.groups], -1)
            scaled = [
                self.net(critic_of(group)).moments.scaled(target)
                for group, target in zip(stack.groups, targets, strict=True)
            ]
            error = (self._scaled_values(stack, own) - torch.cat(scaled, -1)).square()
            means = stack.sums(error, own.alive) / self.parallel.count(stack.counts(own.alive))
            losses.append(means.sum())
            present = stack.present(batch.absent)
            stepped += [critic_of(group) for group in present]
            self._log_present(stack, present, "value_loss", means)
        if stepped:
            self.step_optimizer(torch.stack(losses).sum(), *stepped)

    def _plain_policy(self, group: Group):
        return self.net(group.id).feedforward_parts()

    def _plain_value(self, group: Group):
        if critic_of(group) not in self.module:  # there are other critics, or none
            return None
        return self.net(critic_of(group)).feedforward_parts()

    def _log_present(self, stack: StackedGroups, present: list[Group], name: str, means: Tensor) -> None:
        for group, mean in zip(stack.groups, means.unbind(), strict=True):
            if group in present:
                self.log(group.id, name, mean)

    def _scaled_values(self, stack: StackedGroups, view: GroupView) -> Tensor:
        critic = self.net(critic_of(stack.groups[0]))
        return self._outputs(stack, view, self._plain_value, lambda v: critic.value(v)[..., None]).squeeze(-1)

    @staticmethod
    def _outputs(
        stack: StackedGroups, view: GroupView, plain: Plain, whole: Callable[[GroupView], Tensor]
    ) -> Tensor:
        """Return outputs (M, n, P): of plain networks in few steps, of any other as `whole` gives them."""
        if stack.is_stacked:
            return stack.outputs(view, plain)
        parts = plain(stack.whole)
        return outputs_where(view.alive, *parts, view.observations) if parts else whole(view)


class PPOConfig(JointConfig):
    """RLlib config of independent PPO."""

    algorithm = "ppo"
    critic_module = LocalValue
    network_settings = ("normalize_values",)


class PPO(JointAlgorithm):
    """Independent PPO."""

    config_class = PPOConfig
    learner_class = PPOLearner
