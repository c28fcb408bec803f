"""Detects non-finite rewards, observations and states."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from algorithms.joint.env import Bools, Ints, JointStep


def non_finite(step: JointStep) -> dict[int, BaseException]:
    """Return an error for each environment with a number that is not finite.

    Rewards, observations and global states are checked, those of final moments included.
    """
    parts = list(_numbers(step))
    # One sum is ten times cheaper than a look at every number, and is finite nearly always.
    if np.isfinite(sum(float(array.sum()) for _, array in parts)):
        return {}
    finite: Bools = np.ones(len(step.rewards), bool)
    for rows, array in parts:
        finite[rows] &= np.isfinite(array.reshape(len(array), -1)).all(1)
    return {
        int(b): FloatingPointError("non-finite observation, state or reward") for b in np.flatnonzero(~finite)
    }


def _numbers(step: JointStep) -> Iterator[tuple[Ints, np.ndarray]]:
    """Yield (environments, array) for every array of floating-point numbers."""
    all_envs = np.arange(len(step.rewards))
    yield all_envs, step.rewards
    moments = [(all_envs, step)] if step.final is None else [(all_envs, step), (step.final.rows, step.final)]
    for rows, moment in moments:
        arrays = [leaf for leaves in moment.observations for leaf in leaves.values()]
        if moment.state is not None:
            arrays.append(moment.state)
        yield from ((rows, array) for array in arrays if array.dtype.kind == "f")
