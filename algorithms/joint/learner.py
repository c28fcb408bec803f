"""Learners: an algorithm fills `update_minibatch`, which reads like its paper's pseudo-code."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch
from ray.rllib.core import COMPONENT_RL_MODULE
from ray.rllib.core.learner.torch.torch_learner import TorchLearner
from ray.rllib.core.learner.training_data import TrainingData
from ray.rllib.utils.metrics import NUM_ENV_STEPS_SAMPLED_LIFETIME
from torch import Tensor, distributed

from algorithms.joint.batch import (
    JointView,
    OnPolicyBatch,
    ReplayBatch,
    ReplayGroup,
    cut_sequences,
    shuffled_minibatches,
    to_tensor,
)
from algorithms.joint.config import JointConfig
from algorithms.joint.data_parallel import DataParallel
from algorithms.joint.finite import check_weights
from algorithms.joint.module import critic_of
from algorithms.joint.replay import JointReplay
from algorithms.joint.rollout import JointRollout
from algorithms.joint.spec import Group, JointSpec
from algorithms.joint.threads import torch_threads
from algorithms.parts.advantages import generalised_advantages
from algorithms.parts.masking import standardised
from algorithms.parts.noise import RowGenerator
from algorithms.parts.optimisation import clip_gradients, follow, step_together
from algorithms.parts.schedule import Schedule, value_at

JOINT, REPLAY = "joint", "replay"
"""Parts of a learner's state besides RLlib's."""


class JointTorchLearner(TorchLearner):
    """A learner over joint data whose losses step chosen modules only.

    RLlib adds all losses up and calls backward once, so that an actor's loss leaks into its critic;
    `step_optimizer` differentiates one loss with respect to the named modules and nothing else.

    Attributes:
        frozen: Networks of policies that RLlib's `policies_to_train` leaves out: nothing moves them.
    """

    config: JointConfig  # type: ignore[assignment]

    def build(self) -> None:
        """Build modules and optimisers, and seed this learner's random numbers."""
        self.generator = RowGenerator()
        self.generator.manual_seed(self.config.seed or 0)
        several = (
            {"size": self.config.num_learners, "rank": distributed.get_rank()} if self.distributed else {}
        )
        self.parallel = DataParallel(self.generator, **several)
        super().build()
        self.spec: JointSpec = self.net(next(iter(self.module.keys()))).spec
        self.groups: tuple[Group, ...] = self.spec.groups
        self.rng = np.random.Generator(np.random.Philox(np.random.SeedSequence([self.config.seed or 0, 1])))
        self.gamma = float(self.config.gamma or 0)
        self.updates = 0
        self.env_steps = 0
        self.frozen = {
            name for g in self.groups if not self.config.trains(g.id) for name in (g.id, critic_of(g))
        }
        self._parameters = {mid: self.net(mid).trained_parameters() for mid in self.module.keys()}  # noqa: SIM118
        self._followed = {mid: self._target_pairs(mid) for mid in self._parameters}
        self._means: dict[tuple[str, str], list[Tensor]] = {}

    def _target_pairs(self, module_id: str) -> list[tuple[Tensor, Tensor]]:
        """Return the parameters of a network's targets, each with the one that it follows."""
        net, pairs = self.net(module_id), []
        for name in net.targets:
            target, original = getattr(net, name), getattr(net, name.removeprefix("target_"))
            pairs += zip(target.parameters(), original.parameters(), strict=True)
        return pairs

    def _make_modules_ddp_if_necessary(self) -> None:
        """Begin with the weights of the first learner (RLlib).

        RLlib's wrapper averages the gradients of `backward`; `step_optimizer` averages them itself.
        """
        for module_id in self.module.keys():  # noqa: SIM118 - RLlib's module is no dict
            self.parallel.broadcast(*self.net(module_id).state_dict().values())

    def net(self, module_id: str) -> Any:
        """Return a network without RLlib's wrapping for distributed training."""
        return self.module[module_id].unwrapped()

    def configure_optimizers_for_module(self, module_id: str, config: Any = None) -> None:
        """Create one Adam for every module, over its parameters without target networks."""
        if parameters := self.net(module_id).trained_parameters():
            self.register_optimizer(
                module_id=module_id,
                optimizer=torch.optim.Adam(parameters, eps=1e-5, fused=True),
                params=parameters,
                lr_or_lr_schedule=config.lr,
            )

    @staticmethod
    def _set_optimizer_lr(optimizer: torch.optim.Optimizer, lr: Any) -> None:
        # RLlib's schedules give tensors, which Adam over lists of tensors (`foreach`) refuses.
        for group in optimizer.param_groups:
            group["lr"] = float(lr)

    def step_optimizer(self, loss: Tensor, *module_ids: str) -> None:
        """Take one gradient step on `loss` with respect to these modules, and no others.

        The gradient of each module is clipped by its own norm. The caller leaves out modules
        of groups without an active agent, see `JointView.absent`; frozen ones are left out here.
        """
        module_ids = tuple(module_id for module_id in module_ids if module_id not in self.frozen)
        if not module_ids:
            return
        owned = [self._parameters[module_id] for module_id in module_ids]
        flat = [p for parameters in owned for p in parameters]
        gradients = torch.autograd.grad(loss, flat, allow_unused=True)
        used = [p for p, gradient in zip(flat, gradients, strict=True) if gradient is not None]
        averaged = self.parallel.average([gradient for gradient in gradients if gradient is not None])
        for p, gradient in zip(used, averaged, strict=True):
            # The fused optimiser reads memory in order, whatever the gradient's strides say.
            p.grad = gradient.contiguous()
        norms = clip_gradients(owned, self.config.grad_clip, self.config.grad_clip_by)
        for module_id, norm in zip(module_ids, norms, strict=True):
            self.log(module_id, "gradient_norm", norm)
        step_together(self.get_optimizer(module_id) for module_id in module_ids)  # type: ignore[arg-type]
        for p in used:
            p.grad = None

    def step_each(self, losses: Mapping[str, Tensor]) -> None:
        """Take one gradient step of each module on its own loss, which depends on no other of them."""
        if losses:
            self.step_optimizer(torch.stack(list(losses.values())).sum(), *losses)

    def schedule_value(self, schedule: Schedule) -> float:
        """Return the value of a setting at this update, which may be a schedule over environment steps."""
        return value_at(schedule, self.env_steps)

    def mean(self, x: Tensor, mask: Tensor) -> Tensor:
        """Return the mean over active agents; every term of every loss goes through here.

        With several learners it is this one's share: its average over learners is the mean.
        """
        return torch.where(mask, x, 0).sum() / self.parallel.count(mask.sum())

    def log(self, module_id: str, name: str, value: Tensor) -> None:
        """Report the mean of a number over this update; read from the device only once an update."""
        self._means.setdefault((module_id, name), []).append(value.detach().to(self._device))

    def polyak_update(self, *module_ids: str, tau: float) -> None:
        """Move target networks towards their originals: target <- (1 - tau) * target + tau * original.

        An attribute `target_x` of a module's `targets` follows its attribute `x`.
        """
        pairs = [pair for name in module_ids if name not in self.frozen for pair in self._followed[name]]
        follow(pairs, tau)

    def update(self, *, training_data: TrainingData, timesteps: dict[str, Any], **kwargs: Any) -> Any:  # type: ignore[override]
        """Learn from one rollout (RLlib).

        Raises:
            LearnerFailure: Weights are not finite any more. Several learners return it, see `failure`.
        """
        try:
            return self._learn(training_data, timesteps)
        except Exception as error:
            return self.parallel.failure(error)

    def _learn(self, training_data: TrainingData, timesteps: dict[str, Any]) -> dict[str, Any]:
        self.before_gradient_based_update(timesteps=timesteps)
        self.env_steps = int(timesteps[NUM_ENV_STEPS_SAMPLED_LIFETIME])
        training_data.solve_refs()
        self._weights_seq_no += 1
        with torch_threads(self.config.torch_threads):
            self.update_joint(training_data.rollout)  # type: ignore[attr-defined] - JointTrainingData
        self.after_gradient_based_update(timesteps=timesteps)
        check_weights(self._parameters, self.env_steps)
        self._report()
        return self.metrics.reduce()

    def _report(self) -> None:
        """Log the means of what was reported in this update."""
        if self._means:
            means = torch.stack([torch.stack(values).mean() for values in self._means.values()])
            for key, mean in zip(self._means, self.parallel.average([means])[0].tolist(), strict=True):
                self.metrics.log_value(key, mean, window=1)
            self._means.clear()
        self._log_trainable_parameters()  # RLlib does so once, and later results would be NaN

    def update_joint(self, rollout: JointRollout) -> None:
        """Learn from one rollout."""
        raise NotImplementedError

    def compute_loss_for_module(self, **kwargs: Any) -> Tensor:
        """Raise: losses belong to `update_minibatch` (RLlib)."""
        raise NotImplementedError("joint learners compute their losses in update_minibatch")

    def get_state(self, components=None, *, not_components=None, **kwargs: Any) -> dict[str, Any]:
        """Return RLlib's state and that of the random numbers and counters."""
        state = super().get_state(components, not_components=not_components, **kwargs)
        if self._check_component(JOINT, components, not_components):
            state[JOINT] = self._own_state()
        # RLlib's arrays share memory with the live tensors; a snapshot that is kept must not learn with them.
        return copy.deepcopy(state) if components is None and not not_components else state

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore, older weights too, which RLlib's learner would silently ignore.

        Runners know weights by their number, so restored weights get one that no runner has: another
        training may have counted as far.
        """
        before = self._weights_seq_no
        if COMPONENT_RL_MODULE in state:
            self._weights_seq_no = -1
        super().set_state(state)
        self._weights_seq_no = max(before, self._weights_seq_no) + 1
        if JOINT in state:
            self._set_own_state(state[JOINT])

    def _own_state(self) -> dict[str, Any]:
        return {
            "generator": self.generator.get_state().numpy(),
            "rng": self.rng.bit_generator.state,
            "updates": self.updates,
            "env_steps": self.env_steps,
            "lr": self.config.lr,
        }

    def _set_own_state(self, state: dict[str, Any]) -> None:
        self.generator.set_state(torch.tensor(state["generator"]))
        self.rng.bit_generator.state = state["rng"]
        self.updates = state["updates"]
        self.env_steps = state["env_steps"]
        # Optimisers came with the rate they were stored with, which RLlib changes after an update only.
        for optimizer, rate in self._optimizer_lr_schedules.items():
            now = rate.update(self.env_steps) if self.env_steps else rate.get_current_value()
            self._set_optimizer_lr(optimizer, now)


class OnPolicyLearner(JointTorchLearner):
    """Learns from each rollout once: `prepare` makes the batch, then come epochs of minibatches."""

    def values(self, view: JointView) -> Tensor:
        """Return state values (M, N) of M moments, without gradient: the second slot."""
        raise NotImplementedError

    def update_minibatch(self, batch: OnPolicyBatch) -> None:
        """Take the gradient steps of one minibatch: the slot that an algorithm fills."""
        raise NotImplementedError

    def update_joint(self, rollout: JointRollout) -> None:
        """Run the epochs over the batch that `prepare` makes."""
        for minibatch in self.minibatches(self.prepare(rollout)):
            self.update_minibatch(minibatch)
        self.updates += 1

    def minibatches(self, batch: OnPolicyBatch) -> Iterator[OnPolicyBatch]:
        """Yield this learner's rows of the minibatches of all epochs."""
        whole = shuffled_minibatches(batch, self.config.minibatch_size, self.config.epochs, self.generator)
        for minibatch in whole:
            with self.parallel.own_rows(minibatch) as own:
                yield own

    def prepare(self, rollout: JointRollout) -> OnPolicyBatch:
        """Return all transitions of the rollout, T*B rows, with generalised advantages and value targets."""
        device, masks = self._device, rollout.masks()
        views = JointView.of(self.spec, rollout.views, device)
        final = JointView.of(self.spec, rollout.final, device)
        with torch.no_grad():
            values = self.values(views.flat()).unflatten(0, rollout.views.alive.shape[:2])
            final_values = self.values(final) if len(final) else values.new_zeros(0, values.shape[-1])
        alive = views.alive[:-1]
        rewards, bootstrap, chain = (
            to_tensor(x, device) for x in (rollout.rewards, masks.bootstrap, masks.chain)
        )
        advantages, targets = generalised_advantages(
            rewards * self.config.reward_scale,
            values,
            final_values,
            to_tensor(rollout.final_at, device),
            bootstrap,
            chain,
            gamma=self.gamma,
            lambda_=self.config.lambda_,
        )
        self.report_values(values[:-1], targets, alive)
        return self.batch(rollout, views, self._scaled(advantages, alive), targets)

    def batch(
        self, rollout: JointRollout, views: JointView, advantages: Tensor, targets: Tensor
    ) -> OnPolicyBatch:
        """Return all transitions of the rollout, T*B rows or whole sequences, with scores (T, B, N)."""
        device, masks, rows = self._device, rollout.masks(), views[:-1].flat()
        known = rollout.log_prob
        log_prob = torch.zeros_like(targets) if known is None else to_tensor(known, device)
        batch = OnPolicyBatch(
            *rows.moments(),
            actions=tuple(to_tensor(a, device).flatten(0, 1) for a in rollout.actions),
            rewards=to_tensor(rollout.rewards, device).flatten(0, 1),
            bootstrap=to_tensor(masks.bootstrap, device).flatten(0, 1),
            log_prob=log_prob.flatten(0, 1),
            advantages=advantages.flatten(0, 1),
            targets=torch.where(rows.alive, targets.flatten(0, 1), 0),
            fresh=to_tensor(masks.fresh[:-1], device).flatten(0, 1) if self.config.gru else None,
        )
        if not self.config.gru:
            return batch
        return cut_sequences(batch, len(rollout.rewards), self.config.sequence_length)

    def report_values(self, values: Tensor, targets: Tensor, alive: Tensor) -> None:
        """Report the share of the variance of targets (..., N) that values explain, 0 where there is none."""
        for group in self.groups:
            there = alive[..., group.columns]
            wanted, missed = (x[..., group.columns][there] for x in (targets, targets - values))
            if len(wanted) > 1:
                spread = wanted.var()
                share = torch.where(spread > 0, 1 - missed.var() / spread, 0)
                self.log(group.id, "explained_variance", share)

    def _scaled(self, advantages: Tensor, alive: Tensor) -> Tensor:
        """Standardise per policy network, over the active agents of the whole batch, before any minibatch."""
        if not self.config.normalize_advantages:
            return torch.where(alive, advantages, 0)
        scaled = torch.zeros_like(advantages)
        for group in self.groups:
            own = (..., group.columns)
            scaled[own] = standardised(advantages[own], alive[own])
        return scaled


class OffPolicyLearner(JointTorchLearner):
    """Keeps a replay buffer and takes a fixed number of updates per environment step."""

    def build(self) -> None:
        """Build modules, and the replay buffer."""
        super().build()
        self.replay = self.make_replay()
        self._owed = 0.0

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Take the gradient steps of one minibatch: the slot that an algorithm fills."""
        raise NotImplementedError

    def td_target(self, own: ReplayBatch | ReplayGroup, following: Tensor) -> Tensor:
        """Return r + gamma v, with v (M, n) the values of what follows, where anything does."""
        return self.config.reward_scale * own.rewards + self.gamma * torch.where(own.bootstrap, following, 0)

    def make_replay(self) -> JointReplay:
        """Return an empty replay buffer: of sequences, where policies are recurrent."""
        return JointReplay(
            self.spec, self.config.capacity, self.config.sequence_length if self.config.gru else 1
        )

    def update_joint(self, rollout: JointRollout) -> None:
        """Store the rollout, then learn from samples of everything stored."""
        self.replay.add(rollout)
        if len(self.replay) < self.config.learning_starts:
            return
        self._owed += rollout.env_steps() * self.config.updates_per_step
        while self._owed >= 1:
            self._owed -= 1
            self.updates += 1
            batch = self.replay.sample(self.rng, self.config.batch_size, self._device)
            with self.parallel.own_rows(batch) as own:
                self.update_minibatch(own)

    def get_state(self, components=None, *, not_components=None, **kwargs: Any) -> dict[str, Any]:
        """Return also the replay buffer, unless the config leaves it out of checkpoints."""
        state = super().get_state(components, not_components=not_components, **kwargs)
        if self.config.checkpoint_replay and self._check_component(REPLAY, components, not_components):
            state[REPLAY] = self.replay.get_state()
        return state

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore; without a stored replay buffer learning continues with the present one."""
        super().set_state(state)
        if REPLAY in state:
            self.replay.set_state(state[REPLAY])

    def _own_state(self) -> dict[str, Any]:
        return {**super()._own_state(), "owed": self._owed}

    def _set_own_state(self, state: dict[str, Any]) -> None:
        super()._set_own_state(state)
        self._owed = state["owed"]
