"""Whole lives from fragments: what has not ended yet is held until it does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from algorithms.errors import EnvironmentFailure
from algorithms.joint.env import Bools, Ints
from algorithms.joint.rollout import JointRollout, View


class OpenTrajectories:
    """The steps of lives that go on beyond the last fragment.

    A life ends when its agent terminates, is cut by a time limit or leaves. A life that a failure of the
    environment breaks off has no end: it is dropped. A copy that does not go on where it stood (its runner
    was restarted) loses its open lives.

    Args:
        longest: Steps that a life may take.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._held: JointRollout | None = None
        self._spent = np.zeros(0, bool)

    def add(self, rollout: JointRollout) -> tuple[JointRollout, Bools]:
        """Return what was held with a new fragment behind it, and which actions (T, B, N) to learn from.

        Every action of every life that ends is handed out once, with the fragment in which the life ends.

        Raises:
            EnvironmentFailure: A life is longer than `longest`.
        """
        spent = np.zeros(rollout.rewards.shape, bool)
        if self._held is not None:
            earlier, known = _aligned(self._held, rollout)
            before = self._spent[:, known] | (known < 0)[None, :, None]
            # Where a copy begins anew, the void step keeps its columns from linking to somebody else's life.
            earlier.failed[-1, known < 0] = True
            rollout, spent = _behind(earlier, rollout), np.concatenate([before, spent])
        going, broken = _fates(rollout)
        ready = rollout.views.alive[:-1] & ~(going | broken | spent)
        self._hold(rollout, going)
        return rollout, ready

    def get_state(self) -> dict[str, Any]:
        """Return what is held."""
        return {"held": self._held, "spent": self._spent}

    def set_state(self, state: dict[str, Any]) -> None:
        """Hold what `get_state` gave."""
        self._held, self._spent = state["held"], state["spent"]

    def _hold(self, rollout: JointRollout, going: Bools) -> None:
        steps = np.flatnonzero(going.any((1, 2)))
        if not len(steps):
            self._held = None
            return
        first = int(steps[0])
        if len(going) - first > self._longest:
            raise EnvironmentFailure(
                f"a life has lasted {len(going) - first} steps and goes on",
                place="algorithm that learns from whole lives",
                remedy="give episodes a time limit, raise `longest_trajectory`, or use 'a2c'",
            )
        self._held = _part(rollout, first, np.arange(going.shape[1]))
        self._spent = ~going[first:]


def _fates(rollout: JointRollout) -> tuple[Bools, Bools]:
    """Return the steps (T, B, N) of lives that go on beyond the data, and of lives broken off."""
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
    """Return who (B, N) had an end of their own in step t."""
    return rollout.terminated[t] | rollout.truncated[t] | rollout.reset[t][:, None]


def _aligned(held: JointRollout, rollout: JointRollout) -> tuple[JointRollout, Ints]:
    """Return what is held in the order of the new fragment's copies, and the places it had, -1 if unknown."""
    reached = held.start + len(held.rewards)
    place = {(*s, n): b for b, (s, n) in enumerate(zip(held.source.tolist(), reached.tolist(), strict=True))}
    asked = zip(rollout.source.tolist(), rollout.start.tolist(), strict=True)
    known = np.array([place.get((*s, n), -1) for s, n in asked])
    return _part(held, 0, known), known


def _part(rollout: JointRollout, first: int, copies: Ints) -> JointRollout:
    """Return copies of some columns of a rollout from a step on, without final rows."""
    return replace(
        rollout,
        views=rollout.views[first:][:, copies],
        actions=tuple(actions[first:, copies] for actions in rollout.actions),
        rewards=rollout.rewards[first:, copies],
        terminated=rollout.terminated[first:, copies],
        truncated=rollout.truncated[first:, copies],
        reset=rollout.reset[first:, copies],
        failed=rollout.failed[first:, copies],
        log_prob=None if rollout.log_prob is None else rollout.log_prob[first:, copies],
        final=rollout.final[:0],
        final_at=rollout.final_at[:0],
        source=rollout.source[copies],
        start=rollout.start[copies] + first,
    )


def _behind(earlier: JointRollout, later: JointRollout) -> JointRollout:
    """Return two fragments of the same copies, one after the other, without final rows."""

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(earlier, name), getattr(later, name)])

    both = None if later.log_prob is None or earlier.log_prob is None else joined("log_prob")
    return replace(
        later,
        views=View.concat([earlier.views[:-1], later.views], 0),
        actions=tuple(map(np.concatenate, zip(earlier.actions, later.actions, strict=True))),
        rewards=joined("rewards"),
        terminated=joined("terminated"),
        truncated=joined("truncated"),
        reset=joined("reset"),
        failed=joined("failed"),
        log_prob=both,
        final=later.final[:0],
        final_at=later.final_at[:0],
        start=earlier.start,
    )
