"""Replay of transitions, single or in sequences: a ring of joint rows with their true next moments."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from algorithms.joint.batch import JointView, ReplayBatch
from algorithms.joint.env import Ints
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
        self._now = View.empty(spec.spaces, capacity)
        self._next = View.empty(spec.spaces, capacity)
        self._actions = tuple(stored_actions(b.action, (capacity, len(b.agents))) for b in spec.spaces.blocks)
        self._rewards = np.zeros((capacity, agents), np.float32)
        self._bootstrap = np.zeros((capacity, agents), bool)
        self._fresh = np.zeros((capacity, agents), bool)
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
        following = rollout.views[t + 1, b]
        # Row t + 1 of an environment that was reset is another episode: no agent is active after a
        # terminal step.
        for array in _view_arrays("", following).values():
            array[rollout.reset[t, b]] = 0
        _overwrite(following, rollout, t, b)
        rows = (self._place + np.arange(len(t))) % self.capacity
        incoming = _arrays(
            rollout.views[t, b],
            following,
            tuple(actions[t, b] for actions in rollout.actions),
            rollout.rewards[t, b],
            masks.bootstrap[t, b],
            masks.fresh[t, b],
        )
        for name, array in self._arrays().items():
            array[rows] = incoming[name]
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
        now = JointView.of(self._spec, self._now[rows], device)
        return ReplayBatch(
            *now.moments(),
            actions=tuple(torch.from_numpy(actions[rows]).to(device) for actions in self._actions),
            rewards=torch.from_numpy(self._rewards[rows]).to(device),
            bootstrap=torch.from_numpy(self._bootstrap[rows]).to(device),
            next=JointView.of(self._spec, self._next[rows], device),
            rows=torch.from_numpy(rows).to(device),
            weights=weights,
            fresh=torch.from_numpy(self._fresh[rows]).to(device) if self.length > 1 else None,
            length=self.length,
        )

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the stored transitions."""
        arrays = {name: array[: self._size].copy() for name, array in self._arrays().items()}
        where = {"size": self._size, "place": self._place, "capacity": self.capacity}
        return {"arrays": arrays, **where}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` gave; with another capacity, the newest transitions that fit."""
        rows = self._restored(state)
        for name, array in self._arrays().items():
            array[: len(rows)] = state["arrays"][name][rows]
        self._size = len(rows)
        same = state["capacity"] == self.capacity
        self._place = state["place"] if same else self._size % self.capacity

    def _restored(self, state: dict[str, Any]) -> Ints:
        """Return which stored rows of a state to take over: oldest first where the capacity differs."""
        rows = np.arange(state["size"])
        if state["capacity"] == self.capacity:
            return rows
        return np.roll(rows, -state["place"])[-self.capacity :]

    def _arrays(self) -> dict[str, np.ndarray]:
        return _arrays(self._now, self._next, self._actions, self._rewards, self._bootstrap, self._fresh)


def _overwrite(following: View, rollout: JointRollout, t: np.ndarray, b: np.ndarray) -> None:
    """Put final rows in the place of next rows that belong to other trajectories."""
    place = {at: k for k, at in enumerate(map(tuple, rollout.final_at.tolist()))}
    pairs = [
        (row, place[at]) for row, at in enumerate(zip(t.tolist(), b.tolist(), strict=True)) if at in place
    ]
    if not pairs:
        return
    rows, finals = (list(column) for column in zip(*pairs, strict=True))
    target, source = _view_arrays("", following), _view_arrays("", rollout.final)
    for name, array in target.items():
        array[rows] = source[name][finals]


def _view_arrays(prefix: str, view: View) -> dict[str, np.ndarray]:
    arrays = {
        f"{prefix}observations/{k}/{name}": leaf
        for k, leaves in enumerate(view.observations)
        for name, leaf in leaves.items()
    }
    arrays[f"{prefix}alive"] = view.alive
    arrays |= {f"{prefix}masks/{k}": mask for k, mask in enumerate(view.masks) if mask is not None}
    if view.state is not None:
        arrays[f"{prefix}state"] = view.state
    if view.graph is not None:
        arrays[f"{prefix}graph"] = view.graph
    return arrays


def _arrays(
    now: View, following: View, actions, rewards: np.ndarray, bootstrap: np.ndarray, fresh: np.ndarray
) -> dict[str, np.ndarray]:
    acted = {f"actions/{k}": part for k, part in enumerate(actions)}
    return {
        **_view_arrays("now/", now),
        **_view_arrays("next/", following),
        **acted,
        "rewards": rewards,
        "bootstrap": bootstrap,
        "fresh": fresh,
    }
