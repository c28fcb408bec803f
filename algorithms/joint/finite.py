"""Detects non-finite rewards, observations, states and weights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from algorithms.errors import LearnerFailure
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


def check_weights(networks: Mapping[str, Sequence[Tensor]], steps: int) -> None:
    """Raise if weights are not finite: no update mends them, and no checkpoint should hold them.

    Args:
        networks: Parameters of each network.
        steps: Environment steps so far.

    Raises:
        LearnerFailure: They are not; names the networks.
    """
    flat = [p for own in networks.values() for p in own]
    if not flat or bool(torch.stack(torch._foreach_norm(flat)).isfinite().all()):  # pyright: ignore[reportPrivateImportUsage]
        return
    broken = [name for name, own in networks.items() if not all(p.isfinite().all() for p in own)]
    raise LearnerFailure(
        f"weights of {', '.join(broken or networks)} are not finite after {steps} environment steps",
        place="learner",
        remedy="lower `lr`, set `grad_clip`, or make rewards smaller with `reward_scale`",
    )
