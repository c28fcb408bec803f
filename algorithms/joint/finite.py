"""Detects non-finite rewards, observations, states and weights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from algorithms.errors import LearnerFailure
from algorithms.joint.env import Ints, JointStep


def non_finite(step: JointStep, agents: Sequence[str]) -> dict[int, BaseException]:
    """Return an error for each environment with numbers that are not finite, which names them and the agents.

    Rewards, observations and global states are checked, those of final moments included.

    Args:
        step: The step.
        agents: Names of all N agents in column order.
    """
    parts = list(_numbers(step))
    # One sum is ten times cheaper than a look at every number, and is finite nearly always.
    if np.isfinite(sum(float(array.sum()) for _, array, _, _ in parts)):
        return {}
    found: dict[int, list[str]] = {}
    for rows, array, what, columns in parts:
        broken = ~np.isfinite(array.reshape(*array.shape[: 1 + bool(columns)], -1)).all(-1)
        for row, *place in np.argwhere(broken).tolist():
            whose = f" of agent {agents[columns[place[0]]]!r}" if columns else ""
            found.setdefault(int(rows[row]), []).append(what + whose)
    return {
        b: FloatingPointError(f"NaN or infinity: {', '.join(dict.fromkeys(names))}")
        for b, names in sorted(found.items())
    }


def _numbers(step: JointStep) -> Iterator[tuple[Ints, np.ndarray, str, range]]:
    """Yield (environments, array, meaning, agents' columns) for every array of floating-point numbers."""
    all_envs, count = np.arange(len(step.rewards)), step.rewards.shape[1]
    yield all_envs, step.rewards, "reward", range(count)
    moments = [(all_envs, step)] if step.final is None else [(all_envs, step), (step.final.rows, step.final)]
    for rows, moment in moments:
        first = 0
        for leaves in moment.observations:
            size = next(iter(leaves.values())).shape[1] if leaves else 0
            columns, first = range(first, first + size), first + size
            for name, leaf in leaves.items():
                if leaf.dtype.kind == "f":
                    yield rows, leaf, f"observation {name!r}" if name else "observation", columns
        if moment.state is not None:
            yield rows, moment.state, "state", range(0)


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
