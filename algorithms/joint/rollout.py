"""Dense experience: T steps of B environments as arrays `[T, B, ...]`, time first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from algorithms.joint.env import (
    CARRIED,
    LATENT,
    MEMORY,
    Bools,
    FinalStep,
    Floats,
    Ints,
    JointSpaces,
    JointStep,
    Leaves,
    map_arrays,
)
from algorithms.joint.masks import Masks, derive_masks
from algorithms.joint.spaces import stored_actions

Blocks = tuple[dict[str, np.ndarray], ...]
BY_STEP = ("actions", "rewards", "terminated", "truncated", "reset", "failed", "log_prob")
"""Fields of rollouts with the leading axes (T, B)."""


@dataclass
class View:
    """Observations, masks and state; the leading axes are (T + 1, B) or (K,).

    Attributes:
        observations: Per block, leaves (..., n, ...).
        alive: Active agents, (..., N).
        masks: Per block, action masks (..., n, A), or None.
        state: Global state (..., S), or None.
        graph: Communication graph (..., N, N), or None.
    """

    observations: Blocks
    alive: Bools
    masks: tuple[Bools | None, ...]
    state: Floats | None
    graph: Bools | None

    @classmethod
    def empty(cls, spaces: JointSpaces, *leading: int) -> View:
        """Return an unfilled view with the given leading axes, leaves in the dtype of their space."""
        agents = sum(len(block.agents) for block in spaces.blocks)
        return cls(
            tuple(
                {
                    name: np.empty((*leading, len(block.agents), *space.shape), space.dtype)
                    for name, space in block.observation.items()
                }
                for block in spaces.blocks
            ),
            np.zeros((*leading, agents), bool),
            tuple(
                np.empty((*leading, len(block.agents), int(block.action.n)), bool)  # type: ignore[union-attr]
                if block.masked
                else None
                for block in spaces.blocks
            ),
            np.empty((*leading, spaces.state), np.float32) if spaces.state else None,
            np.empty((*leading, agents, agents), bool) if spaces.has_graph else None,
        )

    def __getitem__(self, index) -> View:
        return View(*map_arrays(lambda array: array[index], self.arrays()))

    def arrays(self) -> tuple[Any, ...]:
        """Return the arrays in the order of the fields."""
        return self.observations, self.alive, self.masks, self.state, self.graph

    def write(self, index, seen: JointStep | FinalStep | View) -> None:
        """Write all but `alive` at `index`; carried leaves that are not given are kept."""
        for mine, theirs in zip(self.observations, seen.observations, strict=True):
            for name, leaf in mine.items():
                if name in theirs or not name.startswith(CARRIED):
                    leaf[index] = theirs[name]
        for mask, action_mask in zip(self.masks, seen.masks, strict=False):
            if mask is not None:
                mask[index] = action_mask
        if self.state is not None:
            self.state[index] = seen.state
        if self.graph is not None:
            self.graph[index] = seen.graph

    @staticmethod
    def concat(views: Sequence[View], axis: int) -> View:
        """Join views along a leading axis."""
        if len(views) == 1:
            return views[0]
        return View(*joined([view.arrays() for view in views], axis))


def joined(parts: Sequence[Any], axis: int) -> Any:
    """Return arrays, or nested tuples and dicts of them, joined along an axis; None where there are none."""
    return map_arrays(lambda *arrays: np.concatenate(arrays, axis), *parts)


@dataclass
class JointRollout:
    """A fragment of T steps of B environments.

    Attributes:
        views: What agents saw, leading axes (T + 1, B).
        actions: Per block, module actions (T, B, n) int64 or (T, B, n, k) float32; 0 where not alive.
        rewards: Shape (T, B, N); 0 where not alive.
        terminated: Shape (T, B, N).
        truncated: Shape (T, B, N).
        reset: Environments that were reset after the step, (T, B).
        failed: Environments whose step is invalid, (T, B).
        log_prob: Log-probability of the actions, (T, B, N), where the policy has one.
        final: True next observations of trajectories that end in mid-fragment, leading axis (K,);
            `final.alive` marks the agents that are still seen in them.
        final_at: Places (t, b) of the final rows, shape (K, 2).
        source: (worker, restart_id, env_id) of each environment, shape (B, 3).
        start: Number of steps each environment had made before this fragment, (B,).

    An object and no tuple, since RLlib would flatten a dict or a tuple.
    """

    views: View
    actions: tuple[np.ndarray, ...]
    rewards: Floats
    terminated: Bools
    truncated: Bools
    reset: Bools
    failed: Bools
    log_prob: Floats | None
    final: View
    final_at: Ints
    source: Ints
    start: Ints
    _finals: dict[tuple[int, int], tuple[FinalStep, int]] = field(default_factory=dict, repr=False)

    @classmethod
    def empty(cls, spaces: JointSpaces, steps: int, num_envs: int, *, log_prob: bool) -> JointRollout:
        """Return an unfilled fragment."""
        shape = (steps, num_envs, sum(len(block.agents) for block in spaces.blocks))
        return cls(
            views=View.empty(spaces, steps + 1, num_envs),
            actions=tuple(stored_actions(b.action, (steps, num_envs, len(b.agents))) for b in spaces.blocks),
            rewards=np.zeros(shape, np.float32),
            terminated=np.zeros(shape, bool),
            truncated=np.zeros(shape, bool),
            reset=np.zeros(shape[:2], bool),
            failed=np.zeros(shape[:2], bool),
            log_prob=np.zeros(shape, np.float32) if log_prob else None,
            final=View.empty(spaces, 0),
            final_at=np.zeros((0, 2), int),
            source=np.zeros((num_envs, 3), int),
            start=np.zeros(num_envs, int),
        )

    def write(self, t: int, step: JointStep) -> None:
        """Record step t: rows t of outcomes and t + 1 of views."""
        self.views.write(t + 1, step)
        self.views.alive[t + 1] = step.alive
        acted = self.views.alive[t]
        np.multiply(step.rewards, acted, out=self.rewards[t])
        self.terminated[t] = step.terminated & acted
        self.truncated[t] = step.truncated & acted
        self.reset[t] = step.reset
        if step.final is not None:
            # Environments may reuse their arrays, so what is kept until `close` is copied.
            kept = FinalStep(*map_arrays(np.copy, step.final))
            self._finals.update({(t, int(b)): (kept, k) for k, b in enumerate(kept.rows)})
        if step.failed:
            broken = list(step.failed)
            self.failed[t, broken] = self.reset[t, broken] = True
            self.views.alive[t, broken] = False
            self.rewards[t, broken] = 0
            self.terminated[t, broken] = self.truncated[t, broken] = False

    def close(self) -> JointRollout:
        """Cut the final rows, once all steps are written, and return the fragment.

        A row is cut wherever a trajectory has no next row of its own: at time limits, when an agent is
        truncated or leaves alone, and before a failure. The environment delivers only the rows that it
        overwrote; elsewhere the next row is the true one. Final rows carry memory and latent of the
        trajectory that was cut; rows of the fragment have an empty memory where another trajectory begins.
        """
        masks = self.masks()
        at = np.argwhere(masks.last.any(-1))
        t, b = at[:, 0], at[:, 1]
        final = self.views[t + 1, b]
        for k, (step, env_id) in enumerate(at.tolist()):
            if (step, env_id) in self._finals:
                source, row = self._finals[step, env_id]
                final.write(k, final_row(source, row))
        for leaves, before in zip(final.observations, self.views[t, b].observations, strict=True):
            leaves |= {LATENT: before[LATENT]} if LATENT in before else {}  # of the episode that was cut
        _empty_memories(final.observations, ~masks.bootstrap[t, b])
        final.alive = masks.bootstrap[t, b] | (~self.reset[t, b, None] & self.views.alive[t + 1, b])
        _empty_memories(self.views[1:].observations, ~masks.chain)
        return replace(self, final=final, final_at=at, _finals={})

    def first(self, steps: int) -> JointRollout:
        """Return the first steps of all environments."""
        kept = self.final_at[:, 0] < steps
        return replace(
            self,
            views=self.views[: steps + 1],
            **{name: map_arrays(lambda array: array[:steps], getattr(self, name)) for name in BY_STEP},
            final=self.final[kept],
            final_at=self.final_at[kept],
        )

    def masks(self) -> Masks:
        """Return the masks that learners use; see `algorithms.joint.masks`."""
        return derive_masks(self.views.alive, self.terminated, self.truncated, self.reset, self.failed)

    def env_steps(self) -> int:
        """Return the number of valid steps, over all environments (RLlib asks for it)."""
        return int((~self.failed).sum())

    def agent_steps(self) -> int:
        """Return the number of actions taken by active agents (RLlib asks for it)."""
        return int(self.views.alive[:-1].sum())

    @staticmethod
    def concat(rollouts: Sequence[JointRollout]) -> JointRollout:
        """Join fragments of equal length along the environments."""
        if len(rollouts) == 1:
            return rollouts[0]

        def parts(name: str) -> list[Any]:
            return [getattr(rollout, name) for rollout in rollouts]

        counts = [len(source) for source in parts("source")]
        offsets = np.repeat(np.cumsum([0, *counts[:-1]]), [len(at) for at in parts("final_at")])
        return replace(
            rollouts[0],
            views=View.concat(parts("views"), 1),
            **{name: joined(parts(name), 1) for name in BY_STEP},
            final=View.concat(parts("final"), 0),
            final_at=np.concatenate(parts("final_at")) + np.stack([0 * offsets, offsets], 1),
            source=np.concatenate(parts("source")),
            start=np.concatenate(parts("start")),
        )


def _empty_memories(observations: Sequence[Leaves], ended: Bools) -> None:
    """Empty, in place, the memories of the columns that are `ended`, (..., N)."""
    column = 0
    for leaves in observations:
        width = next(iter(leaves.values())).shape[ended.ndim - 1]
        if MEMORY in leaves:
            leaves[MEMORY][ended[..., column : column + width]] = 0
        column += width


def final_row(final: FinalStep, row: int) -> FinalStep:
    """Return one row of final observations, without its leading axis."""
    return FinalStep(final.rows[row : row + 1], *map_arrays(lambda array: array[row], final[1:]))
