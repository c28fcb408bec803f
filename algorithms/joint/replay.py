"""Replay of transitions, single or in sequences: a ring of joint rows with their true next moments."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from algorithms.joint.batch import JointView, ReplayBatch, to_tensor
from algorithms.joint.env import Ints, map_arrays
from algorithms.joint.rollout import JointRollout, View
from algorithms.joint.spaces import stored_actions
from algorithms.joint.spec import JointSpec


class JointReplay:
    """The last `capacity` joint transitions in which any agent acted.

    Next observations are stored explicitly, so resets, deaths and truncations are resolved once, when a
    rollout is added, at the price of twice the memory: 4 agents at the intersection, 203 numbers each, take
    629 MiB for 100,000 transitions, 312 of them for next observations. To store them once, rows would have to
    point to each other, across fragments of environments that may be restarted and with extra rows for cuts,
    in a ring whose overwriting, restoring and priorities work on single rows.

    Args:
        spec: Agents and spaces.
        capacity: Joint transitions kept, rounded down to whole sequences.
        length: Steps of each sequence; fragments are cut into whole ones. 1: single transitions.
    """

    def __init__(self, spec: JointSpec, capacity: int, length: int = 1) -> None:
        capacity -= capacity % length
        self.capacity, self.length = capacity, length
        self._spec = spec
        agents = len(spec.agents)
        self._kept: dict[str, Any] = {
            "now": View.empty(spec.spaces, capacity).arrays(),
            "next": View.empty(spec.spaces, capacity).arrays(),
            "actions": tuple(stored_actions(b.action, (capacity, len(b.agents))) for b in spec.spaces.blocks),
            "rewards": np.zeros((capacity, agents), np.float32),
            "bootstrap": np.zeros((capacity, agents), bool),
            "fresh": np.zeros((capacity, agents), bool),
        }
        self._size = self._place = 0

    def __len__(self) -> int:
        return self._size

    def add(self, rollout: JointRollout) -> Ints:
        """Store the transitions of a rollout, oldest first; the oldest stored ones are overwritten.

        Returns:
            Their places.
        """
        t, b = self._cut(rollout)
        t, b = t[-self.capacity :], b[-self.capacity :]
        masks = rollout.masks()
        following = rollout.views[t + 1, b].arrays()
        # Row t + 1 of an environment that was reset is another episode: no agent is active after a
        # terminal step.
        ended = np.flatnonzero(rollout.reset[t, b])
        _write(following, ended, map_arrays(lambda array: np.zeros_like(array[ended]), following))
        # Where the trajectory was cut, its final row is the next one.
        numbers = np.full(rollout.reset.shape, -1)
        numbers[tuple(rollout.final_at.T)] = np.arange(len(rollout.final_at))
        final = numbers[t, b]
        cut = np.flatnonzero(final >= 0)
        _write(following, cut, rollout.final[final[cut]].arrays())
        rows = (self._place + np.arange(len(t))) % self.capacity
        incoming = {
            "now": rollout.views[t, b].arrays(),
            "next": following,
            "actions": tuple(actions[t, b] for actions in rollout.actions),
            "rewards": rollout.rewards[t, b],
            "bootstrap": masks.bootstrap[t, b],
            "fresh": masks.fresh[t, b],
        }
        _write(self._kept, rows, incoming)
        self._place = (self._place + len(t)) % self.capacity
        self._size = min(self._size + len(t), self.capacity)
        return rows

    def _cut(self, rollout: JointRollout) -> tuple[Ints, Ints]:
        """Return the (steps, environments) to store: those in which any agent acted, or whole sequences."""
        if self.length == 1:
            t, b = np.nonzero(rollout.views.alive[:-1].any(-1))
            return t, b
        steps, num_envs = rollout.reset.shape
        order = np.arange(steps * num_envs).reshape(steps // self.length, self.length, num_envs)
        return np.divmod(order.transpose(0, 2, 1).ravel(), num_envs)

    def sample(self, rng: np.random.Generator, count: int, device: torch.device | str = "cpu") -> ReplayBatch:
        """Return `count` transitions, in whole sequences, drawn uniformly with replacement."""
        if self.length == 1:
            return self.batch(rng.integers(self._size, size=count), device)
        first = self.length * rng.integers(self._size // self.length, size=max(count // self.length, 1))
        return self.batch((first + np.arange(self.length)[:, None]).ravel(), device)

    def batch(self, rows: Ints, device: torch.device | str, weights: Tensor | None = None) -> ReplayBatch:
        """Return the transitions at the given places."""
        kept = map_arrays(lambda array: array[rows], self._kept)
        now, following = (JointView.of(self._spec, View(*kept[name]), device) for name in ("now", "next"))
        return ReplayBatch(
            *now.moments(),
            actions=map_arrays(partial(to_tensor, device=device), kept["actions"]),
            rewards=to_tensor(kept["rewards"], device),
            bootstrap=to_tensor(kept["bootstrap"], device),
            next=following,
            rows=torch.from_numpy(rows).to(device),
            weights=weights,
            fresh=to_tensor(kept["fresh"], device) if self.length > 1 else None,
            length=self.length,
        )

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the stored transitions."""
        arrays = map_arrays(lambda array: array[: self._size].copy(), self._kept)
        return {"arrays": arrays, "size": self._size, "place": self._place, "capacity": self.capacity}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` gave; with another capacity, the newest transitions that fit."""
        rows = self._restored(state)
        stored = map_arrays(lambda array: array[rows], state["arrays"])
        _write(self._kept, np.arange(len(rows)), stored)
        self._size = len(rows)
        same = state["capacity"] == self.capacity
        self._place = state["place"] if same else self._size % self.capacity

    def _restored(self, state: dict[str, Any]) -> Ints:
        """Return which stored rows of a state to take over: oldest first where the capacity differs."""
        rows = np.arange(state["size"])
        if state["capacity"] == self.capacity:
            return rows
        return np.roll(rows, -state["place"])[-self.capacity :]


def _write(arrays: Any, rows: Ints, given: Any) -> None:
    """Write rows of the arrays of nested tuples and dicts, given by those at equal places."""

    def write(array: np.ndarray, part: np.ndarray) -> None:
        array[rows] = part

    map_arrays(write, arrays, given)
