"""What algorithms see: joint minibatches of tensors, and their parts by parameter-sharing group.

`JointBatch` has rows (moments) as leading axis M. An algorithm file uses `alive`, `bootstrap` and
`next.alive`; it never indexes columns: `batch.groups()` gives each group's part and `batch.join(...)` puts
results together again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from typing import Any, Generic, Self, TypeVar

import numpy as np
import torch
from gymnasium.spaces import Discrete
from torch import Tensor

from algorithms.joint.env import columns_of, map_arrays
from algorithms.joint.rollout import View
from algorithms.joint.spec import Group, JointSpec


@dataclass(frozen=True)
class GroupView:
    """What the n agents of a group see.

    Attributes:
        observations: Leaves (M, n, ...).
        alive: (M, n).
        action_mask: Allowed actions (M, n, A), or None.
        fresh: Where a trajectory begins, (M, n), or None; see `JointView`.
        length: Steps of each sequence.
    """

    observations: Mapping[str, Tensor]
    alive: Tensor
    action_mask: Tensor | None
    fresh: Tensor | None = field(default=None, kw_only=True)
    length: int = field(default=1, kw_only=True)


@dataclass(frozen=True)
class GroupBatch(GroupView):
    """What the n agents of a group saw, did and got.

    Attributes:
        actions: int64 (M, n), or float32 (M, n, k).
        rewards: Individual rewards, (M, n).
        bootstrap: The value of the next moment counts, (M, n).
    """

    actions: Tensor
    rewards: Tensor
    bootstrap: Tensor


@dataclass(frozen=True)
class OnPolicyGroup(GroupBatch):
    """A group's part of a rollout; see `OnPolicyBatch`, everything (M, n)."""

    log_prob: Tensor
    advantages: Tensor
    targets: Tensor


@dataclass(frozen=True)
class ReplayGroup(GroupBatch):
    """A group's part of replayed transitions, with what its agents saw next."""

    next: GroupView


@dataclass(frozen=True)
class JointView:
    """M moments of all N agents; see `View` for the fields.

    Recurrent policies learn from sequences: the M rows are C sequences of L moments, row `l * C + c` being
    moment l of sequence c.

    Attributes:
        fresh: Where a trajectory begins within a sequence, (M, N), or None without sequences.
        length: L.
        active: Agents (N,) that are active in the minibatch of which these are some rows; None: in these.
    """

    spec: JointSpec
    observations: tuple[Mapping[str, Tensor], ...]
    alive: Tensor
    masks: tuple[Tensor | None, ...]
    state: Tensor | None
    graph: Tensor | None
    fresh: Tensor | None = field(default=None, kw_only=True)
    length: int = field(default=1, kw_only=True)
    active: Tensor | None = field(default=None, kw_only=True)

    @classmethod
    def of(cls, spec: JointSpec, view: View, device: torch.device | str = "cpu") -> Self:
        """Return the view as tensors; shares memory with the arrays on the CPU."""
        return cls(spec, *map_arrays(partial(to_tensor, device=device), view.arrays()))

    def moments(self) -> tuple[Any, ...]:
        """Return what a batch of these moments begins with."""
        return self.spec, self.observations, self.alive, self.masks, self.state, self.graph

    def __len__(self) -> int:
        return len(self.alive)

    def __getitem__(self, rows) -> Self:
        """Return the given rows."""
        # By number: half the time of indexing by a tensor.
        if isinstance(rows, Tensor) and rows.dtype == torch.int64:
            return self.map(lambda x: x.index_select(0, rows))
        return self.map(lambda x: x[rows])

    def sequences(self, chosen: Tensor) -> Self:
        """Return the sequences of the given numbers; rows, where sequences have one moment."""
        return self[self.rows_of(chosen)]

    def rows_of(self, chosen: Tensor) -> Tensor:
        """Return the rows of the sequences of the given numbers."""
        if self.length == 1:
            return chosen
        starts = (len(self) // self.length) * torch.arange(self.length, device=chosen.device)
        return (starts[:, None] + chosen).flatten()

    def part_at(self, rows: Tensor) -> Self:
        """Return the given rows as a part of this minibatch: the same agents are `absent`."""
        return replace(self[rows], active=self.alive.any(0))

    def flat(self) -> Self:
        """Return the same moments with the leading (T, B) axes made one."""
        return self.map(lambda x: x.flatten(0, 1))

    def map(self, function) -> Self:
        """Apply a function to every tensor."""
        tensors = [f.name for f in fields(self) if f.name not in ("spec", "length", "active")]
        return replace(self, **{name: _apply(getattr(self, name), function) for name in tensors})

    def view(self, group: Group) -> GroupView:
        """Return what a group's agents see."""
        return GroupView(*self._seen(group), **self._order(group))

    @cached_property
    def absent(self) -> frozenset[str]:
        """Ids of the groups without an active agent in any row of the minibatch.

        A loss says nothing about them, but Adam's momentum would move their networks all the same.
        """
        active = (self.alive.any(0) if self.active is None else self.active).cpu().numpy()
        groups = self.spec.groups
        return frozenset(group.id for group in groups if not active[..., group.columns].any())

    def join(self, parts: Mapping[str, Tensor]) -> Tensor:
        """Return (..., N) or (..., N, x) from each group's (..., n) or (..., n, x), by group id."""
        axis = self.alive.dim() - 1
        groups = self.spec.groups
        if len(groups) == 1:
            return parts[groups[0].id]
        joined = torch.cat([parts[group.id] for group in groups], axis)
        order = np.concatenate([np.arange(self.alive.shape[-1])[group.columns] for group in groups])
        if (order == np.arange(len(order))).all():
            return joined
        return joined.index_select(axis, torch.as_tensor(np.argsort(order), device=joined.device))

    def global_state(self) -> Tensor:
        """Return the environment's state (..., S), else joint observations and which agents are active."""
        return self.everything if self.state is None else self.state

    @cached_property
    def everything(self) -> Tensor:
        """Flat observations side by side, zeros for absent agents, and which agents are active, (..., S)."""
        axis, parts = self.alive.dim(), []
        for block, leaves in zip(columns_of(self.spec.spaces.blocks), self.observations, strict=True):
            there = self.alive[..., block, None]
            flat = (leaf.flatten(axis) if leaf.dim() > axis else leaf[..., None] for leaf in leaves.values())
            parts += [(leaf * there).flatten(-2) for leaf in flat]
        return torch.cat([*parts, self.alive.float()], -1)

    def _order(self, group: Group) -> dict[str, Any]:
        fresh = None if self.fresh is None else self.fresh[..., group.columns]
        return {"fresh": fresh, "length": self.length}

    def _seen(self, group: Group) -> tuple[Mapping[str, Tensor], Tensor, Tensor | None]:
        within = (slice(None),) * (self.alive.dim() - 1) + (group.within,)
        mask = self.masks[group.block]
        return (
            {name: leaf[within] for name, leaf in self.observations[group.block].items()},
            self.alive[..., group.columns],
            None if mask is None else mask[within],
        )


Part = TypeVar("Part", bound=GroupBatch)


@dataclass(frozen=True)
class JointBatch(JointView, Generic[Part]):
    """M transitions of all N agents.

    Attributes:
        actions: Per block, int64 (M, n) or float32 (M, n, k); 0 for inactive agents.
        rewards: Individual rewards, (M, N); 0 for inactive agents.
        bootstrap: Alive and not terminated, so the value of the next moment counts, (M, N).
    """

    actions: tuple[Tensor, ...]
    rewards: Tensor
    bootstrap: Tensor

    def part(self, group: Group) -> Part:
        """Return a group's part."""
        raise NotImplementedError

    def groups(self) -> Iterator[tuple[Group, Part]]:
        """Return every group with its part."""
        return ((group, self.part(group)) for group in self.spec.groups)

    def present(self) -> Iterator[tuple[Group, Part]]:
        """Return every group to be stepped with its part: all but the `absent` ones."""
        return ((group, self.part(group)) for group in self.spec.groups if group.id not in self.absent)

    def encoded_actions(self) -> dict[str, Tensor]:
        """Return the actions as critics see them by group id: one-hot (M, n, A) or raw (M, n, k)."""
        encoded = {}
        for group in self.spec.groups:
            _, alive, _ = self._seen(group)
            actions, _, _ = self._done(group)
            encoded[group.id] = encode(group, actions) * alive[..., None]
        return encoded

    def _done(self, group: Group) -> tuple[Tensor, Tensor, Tensor]:
        own = (..., group.columns)
        return self.actions[group.block][:, group.within], self.rewards[own], self.bootstrap[own]


@dataclass(frozen=True)
class OnPolicyBatch(JointBatch[OnPolicyGroup]):
    """Transitions of one rollout; everything (M, N).

    Attributes:
        log_prob: Log-probability of the actions when they were taken.
        advantages: Standardised where the config says so; 0 for inactive agents.
        targets: What values are regressed on; 0 for inactive agents.
    """

    log_prob: Tensor
    advantages: Tensor
    targets: Tensor

    def part(self, group: Group) -> OnPolicyGroup:
        """Return a group's part."""
        own = (..., group.columns)
        scores = self.log_prob[own], self.advantages[own], self.targets[own]
        return OnPolicyGroup(*self._seen(group), *self._done(group), *scores, **self._order(group))


@dataclass(frozen=True)
class ReplayBatch(JointBatch[ReplayGroup]):
    """Transitions from replay.

    Attributes:
        next: The true next moment, never a reset observation; `next.alive` marks active agents,
            those cut by a time limit included.
        rows: Places in the replay buffer, (M,).
        weights: Importance weights (M,) of prioritised replay, or None.
    """

    next: JointView
    rows: Tensor | None = field(default=None, kw_only=True)
    weights: Tensor | None = field(default=None, kw_only=True)

    def part(self, group: Group) -> ReplayGroup:
        """Return a group's part."""
        parts = *self._seen(group), *self._done(group), self.next.view(group)
        return ReplayGroup(*parts, **self._order(group))


def shuffled_minibatches(
    batch: OnPolicyBatch, size: int | None, epochs: int, generator: torch.Generator
) -> Iterator[OnPolicyBatch]:
    """Yield the minibatches of all epochs: every row, or whole sequence, once in each, in random order.

    Args:
        batch: All rows.
        size: Rows of a minibatch; None: all.
        epochs: How often each row is there.
        generator: Draws the orders.
    """
    count = len(batch) // batch.length
    for _ in range(epochs):
        if size is None or size >= len(batch):
            yield batch
            continue
        order = torch.randperm(count, generator=generator).to(batch.alive.device)
        if batch.length == 1:  # one gather, then views
            shuffled = batch[order]
            for start in range(0, count, size):
                yield shuffled[start : start + size]
            continue
        for chosen in order.split(max(size // batch.length, 1)):
            yield batch.sequences(chosen)


def cut_sequences(batch: OnPolicyBatch, steps: int, length: int) -> OnPolicyBatch:
    """Return the rows of T steps of B environments, in order of time, as sequences of `length` steps.

    T is a multiple of the length.
    """
    rows = torch.arange(len(batch), device=batch.alive.device).unflatten(0, (steps // length, length, -1))
    return replace(batch[rows.transpose(0, 1).flatten()], length=length)


def encode(group: Group, actions: Tensor) -> Tensor:
    """Return actions as critics see them: one-hot (..., A), or raw and flat (..., k)."""
    if isinstance(group.action, Discrete):
        return torch.nn.functional.one_hot(actions, int(group.action.n)).float()
    return actions


def to_tensor(array: np.ndarray, device: torch.device | str = "cpu") -> Tensor:
    """Return the array as a tensor; arrays from Ray's object store are read-only and get copied."""
    tensor = torch.from_numpy(array if array.flags.writeable else array.copy())
    return tensor if device == "cpu" else tensor.to(device)


def _apply(value: Any, function: Callable[[Tensor], Tensor]) -> Any:
    return value.map(function) if isinstance(value, JointView) else map_arrays(function, value)
