"""The mask algebra: from the environment's reports to the masks of learners.

Four masks follow from `alive`, `terminated`, `truncated`, `reset` and `failed`, in this file only:

    bootstrap[t] = alive[t] and not terminated[t]
    chain[t]     = bootstrap[t] and alive[t+1] and not (truncated[t] or reset[t] or failed[t])
    fresh[t+1]   = alive[t+1] and not chain[t]
    last[t]      = bootstrap[t] and not chain[t]

`bootstrap`: the value of the next moment counts. `chain`: row t+1 is the next action of the same trajectory,
so returns accumulate over it. `fresh`: a trajectory begins (late entry, slot reuse, reset), so
memory is cleared.
`last`: the trajectory continues beyond the data, or was cut; its next observation is stored in an extra
*final row*, because row t+1 may belong to another trajectory. A failed step is invalid: it has `alive[t]`
False, so the trajectory before it ends in a final row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from algorithms.joint.env import Bools


class Masks(NamedTuple):
    """The derived masks of a fragment.

    Attributes:
        bootstrap: Shape (T, B, N).
        chain: Shape (T, B, N).
        fresh: Shape (T + 1, B, N); row 0 is False, since a fragment does not know what came before it.
        last: Shape (T, B, N).
    """

    bootstrap: Bools
    chain: Bools
    fresh: Bools
    last: Bools


def same_trajectory(alive: Bools, terminated: Bools, truncated: Bools, over: Bools) -> Bools:
    """Return which of the agents that acted are still in the same trajectory, (..., N).

    Args:
        alive: Active agents, (..., N).
        terminated: Shape (..., N).
        truncated: Shape (..., N).
        over: Environments that were reset or failed, (...).
    """
    return alive & ~terminated & ~truncated & ~over[..., None]


def derive_masks(alive: Bools, terminated: Bools, truncated: Bools, reset: Bools, failed: Bools) -> Masks:
    """Return the masks of a fragment.

    Args:
        alive: Agents that act, shape (T + 1, B, N); False in failed rows.
        terminated: Shape (T, B, N).
        truncated: Shape (T, B, N).
        reset: Environments that were reset after step t, shape (T, B).
        failed: Environments whose step t is invalid, shape (T, B).
    """
    bootstrap = alive[:-1] & ~terminated
    chain = bootstrap & same_trajectory(alive[1:], terminated, truncated, reset | failed)
    fresh = np.concatenate([np.zeros_like(alive[:1]), alive[1:] & ~chain])
    return Masks(bootstrap, chain, fresh, bootstrap & ~chain)
