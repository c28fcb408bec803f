"""Whole trajectories from fragments: a trajectory is held until it ends."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from algorithms.errors import EnvironmentFailure
from algorithms.joint.env import Bools, Ints, map_arrays
from algorithms.joint.rollout import BY_STEP, JointRollout, View, joined


class OpenTrajectories:
    """The steps of trajectories that continue beyond the last fragment.

    A trajectory ends when its agent terminates, is cut by a time limit or leaves. A trajectory that a failure
    of the environment breaks off is dropped. An environment that does not continue where it was (its runner
    was restarted) loses its open trajectories.

    Args:
        longest: Most steps of a trajectory.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._held: JointRollout | None = None
        self._spent = np.zeros(0, bool)

    def add(self, rollout: JointRollout) -> tuple[JointRollout, Bools]:
        """Return the held steps with a new fragment behind them, and which actions (T, B, N) to learn from.

        Every action of every trajectory that ends is returned once, with the fragment in which it ends.

        Raises:
            EnvironmentFailure: A trajectory is longer than `longest`.
        """
        spent = np.zeros(rollout.rewards.shape, bool)
        if self._held is not None:
            earlier, known = _aligned(self._held, rollout)
            before = self._spent[:, known] | (known < 0)[None, :, None]
            # Where an environment restarts, the invalid step keeps its columns from linking to
            # another trajectory.
            earlier.failed[-1, known < 0] = True
            rollout, spent = _behind(earlier, rollout), np.concatenate([before, spent])
        going, broken = _fates(rollout)
        ready = rollout.views.alive[:-1] & ~(going | broken | spent)
        self._hold(rollout, going)
        return rollout, ready

    def get_state(self) -> dict[str, Any]:
        """Return the held steps."""
        return {"held": self._held, "spent": self._spent}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` gave."""
        self._held, self._spent = state["held"], state["spent"]

    def _hold(self, rollout: JointRollout, going: Bools) -> None:
        steps = np.flatnonzero(going.any((1, 2)))
        if not len(steps):
            self._held = None
            return
        first = int(steps[0])
        if len(going) - first > self._longest:
            raise EnvironmentFailure(
                f"a trajectory has lasted {len(going) - first} steps without an end",
                place="algorithm that learns from whole trajectories",
                remedy="give episodes a time limit, raise `longest_trajectory`, or use 'a2c'",
            )
        self._held = _part(rollout, first, np.arange(going.shape[1]))
        self._spent = ~going[first:]


def _fates(rollout: JointRollout) -> tuple[Bools, Bools]:
    """Return the steps (T, B, N) of trajectories that continue beyond the data, and of those broken off."""
    chain, alive = rollout.masks().chain, rollout.views.alive[:-1]
    void_next = np.concatenate([rollout.failed[1:], np.zeros_like(rollout.failed[:1])])
    going, broken = np.zeros_like(chain), np.zeros_like(chain)
    goes, breaks = np.ones_like(chain[0]), np.zeros_like(chain[0])
    for t in range(len(chain) - 1, -1, -1):
        breaks = alive[t] & np.where(chain[t], breaks, void_next[t][:, None] & ~_over(rollout, t))
        goes = chain[t] & goes
        going[t], broken[t] = goes, breaks
    return going, broken


def _over(rollout: JointRollout, t: int) -> Bools:
    """Return which agents (B, N) terminated, were truncated or reset in step t."""
    return rollout.terminated[t] | rollout.truncated[t] | rollout.reset[t][:, None]


def _aligned(held: JointRollout, rollout: JointRollout) -> tuple[JointRollout, Ints]:
    """Return the held steps in the order of the new fragment, and their places, -1 if unknown."""
    reached = held.start + len(held.rewards)
    place = {(*s, n): b for b, (s, n) in enumerate(zip(held.source.tolist(), reached.tolist(), strict=True))}
    asked = zip(rollout.source.tolist(), rollout.start.tolist(), strict=True)
    known = np.array([place.get((*s, n), -1) for s, n in asked])
    return _part(held, 0, known), known


def _part(rollout: JointRollout, first: int, env_ids: Ints) -> JointRollout:
    """Return a copy of some environments of a rollout from a step on, without final rows."""
    return replace(
        rollout,
        views=rollout.views[first:][:, env_ids],
        **{name: map_arrays(lambda x: x[first:, env_ids], getattr(rollout, name)) for name in BY_STEP},
        final=rollout.final[:0],
        final_at=rollout.final_at[:0],
        source=rollout.source[env_ids],
        start=rollout.start[env_ids] + first,
    )


def _behind(earlier: JointRollout, later: JointRollout) -> JointRollout:
    """Return two fragments of the same environments joined in time, without final rows."""
    return replace(
        later,
        views=View.concat([earlier.views[:-1], later.views], 0),
        **{name: joined([getattr(earlier, name), getattr(later, name)], 0) for name in BY_STEP},
        final=later.final[:0],
        final_at=later.final_at[:0],
        start=earlier.start,
    )
