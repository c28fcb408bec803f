"""Behavioural cloning (BC).

Pomerleau 1989, "ALVINN": a policy is fitted to the actions of demonstrations, here by their negative
log-likelihood. Normal noise on observations (`noise`) keeps the policy from reading too much into what drifts
when it acts by itself; frames of an observation are its history.

The demonstrations are single agents' decisions in a Parquet file with RLlib's columns `obs` and `actions`,
and perhaps `action_mask`, as `smarts-bench demonstrations` writes. No environment is stepped in training; a
decision that is read counts as one that is taken, for budgets and schedules.

Deviations: the deviation of continuous actions is learned with their mean.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from gymnasium.spaces import Box, Discrete
from ray.rllib.utils.metrics import (
    ENV_RUNNER_RESULTS,
    LEARNER_RESULTS,
    NUM_AGENT_STEPS_SAMPLED_LIFETIME,
    NUM_ENV_STEPS_SAMPLED_LIFETIME,
)
from torch import Tensor

from algorithms.errors import AlgorithmError
from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView
from algorithms.joint.config import JointConfig
from algorithms.joint.learner import JointTorchLearner
from algorithms.joint.spaces import is_bounded
from algorithms.joint.spec import Group
from algorithms.joint.training_data import JointTrainingData


class DataError(AlgorithmError):
    """Demonstrations that cannot be read, or are not of an environment's agents."""


class Demonstrations(NamedTuple):
    """D decisions of single agents, as the policies of a group see and take them."""

    observations: dict[str, Tensor]
    """By leaf, shape (D, 1, *shape)."""
    actions: Tensor
    """Shape (D, 1), or (D, 1, k) in [-1, 1]."""
    action_mask: Tensor | None
    """Shape (D, 1, A)."""

    @classmethod
    def read(cls, file: str, group: Group, *, masked: bool) -> Demonstrations:
        """Return the content of a file, with action masks if the environment has them.

        Raises:
            DataError: It cannot be read, or is of agents that see or do something else.
        """
        try:
            table = pq.read_table(file)
            obs = np.array(table["obs"].to_pylist(), np.float32)
            actions = np.array(table["actions"].to_pylist())
        except (OSError, KeyError, pa.ArrowException) as error:
            remedy = "give a file that `smarts-bench demonstrations` wrote"
            raise DataError(f"cannot be read: {error}", place=f"data {file!r}", remedy=remedy) from error
        space, sizes = group.action, [int(np.prod(leaf.shape)) for leaf in group.observation.values()]
        wanted = () if isinstance(space, Discrete) else (int(np.prod(space.shape)),)
        if obs.shape[1:] != (sum(sizes),) or actions.shape[1:] != wanted:
            raise DataError(
                f"has observations of {obs.shape[1:]} and actions of {actions.shape[1:]} numbers, where "
                f"{group.agents[0]!r} has {sum(sizes)} and {space}",
                place=f"data {file!r}",
                remedy="demonstrate with the observation and action of the experiment's `environment`",
            )
        parts = np.split(obs, np.cumsum(sizes)[:-1], axis=1)
        leaves = {
            name: torch.from_numpy(part.reshape(len(obs), 1, *leaf.shape))
            for (name, leaf), part in zip(group.observation.items(), parts, strict=True)
        }
        has_mask = masked and "action_mask" in table.column_names
        mask = torch.tensor(table["action_mask"].to_pylist())[:, None] if has_mask else None
        return cls(leaves, torch.from_numpy(_to_module(space, actions))[:, None], mask)


def _to_module(space: Box | Discrete, actions: np.ndarray) -> np.ndarray:
    """Return actions as modules give them, the inverse of `spaces.to_env`."""
    if isinstance(space, Discrete):
        return actions.astype(np.int64) - int(space.start)
    if is_bounded(space):
        low, high = space.low.ravel(), space.high.ravel()
        actions = 2 * (actions - low) / (high - low) - 1
    return actions.astype(np.float32)


class BCLearner(JointTorchLearner):
    """Fits each group's policy to the same demonstrations."""

    @cached_property
    def data(self) -> dict[str, Demonstrations]:
        """The demonstrations as each group takes them; read by the first step, as tests need none.

        Raises:
            DataError: They are not given, cannot be read, or are of other agents.
        """
        if self.config.data is None:
            raise DataError("there are no demonstrations", place="bc", remedy="give their file: data")
        blocks = self.spec.spaces.blocks
        return {
            group.id: Demonstrations.read(self.config.data, group, masked=blocks[group.block].masked)
            for group in self.groups
        }

    def update_joint(self, rollout: Any = None) -> None:
        """Take the steps of an iteration; there is no rollout."""
        for _ in range(self.config.updates):
            self.step_each({group.id: self.loss(group) for group in self.groups})
            self.updates += 1

    def loss(self, group: Group) -> Tensor:
        """Return the mean negative log-likelihood of the actions of some demonstrations."""
        data, net = self.data[group.id], self.net(group.id)
        rows = torch.randint(len(data.actions), (self.config.batch_size,), generator=self.generator)
        leaves = {name: self._noisy(leaf[rows].to(self._device)) for name, leaf in data.observations.items()}
        mask = None if data.action_mask is None else data.action_mask[rows].to(self._device)
        actions = data.actions[rows].to(self._device)
        alive = torch.ones(len(rows), 1, dtype=torch.bool, device=self._device)
        policy = net.head.distribution(net.policy(GroupView(leaves, alive, mask)), mask)
        loss = -policy.log_prob(actions).mean()
        self.log(group.id, "policy_loss", loss)
        self.log(group.id, "entropy", policy.entropy().mean())
        return loss

    def _noisy(self, leaf: Tensor) -> Tensor:
        drawn = torch.empty(leaf.shape).normal_(generator=self.generator).to(leaf.device)
        return leaf + self.config.noise * drawn


class BCConfig(JointConfig):
    """RLlib config of behavioural cloning."""

    algorithm = "bc"


class BC(JointAlgorithm):
    """Behavioural cloning."""

    config_class = BCConfig
    learner_class = BCLearner

    def training_step(self) -> None:
        """Learn from demonstrations; nothing is sampled (RLlib)."""
        count = int(self.config.updates) * int(self.config.batch_size)
        key = ENV_RUNNER_RESULTS, NUM_AGENT_STEPS_SAMPLED_LIFETIME, "demonstrations"
        self.metrics.log_value(key, count, reduce="lifetime_sum")
        key = ENV_RUNNER_RESULTS, NUM_ENV_STEPS_SAMPLED_LIFETIME
        self.metrics.log_value(key, count, reduce="lifetime_sum")
        steps = {NUM_ENV_STEPS_SAMPLED_LIFETIME: self._steps()}
        self.metrics.aggregate(self._update(JointTrainingData(), steps), key=LEARNER_RESULTS)
