"""Compiled: what the loop around the step does in each of its steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]


@kernel
def choose_wanted(next_due: Ints, step: Ints, egos: int, observe_mask: Bools, is_last: bool) -> None:
    """Say who is to be observed after the coming step: egos after the last of a decision, others when due."""
    for b in range(observe_mask.shape[0]):
        for a in range(observe_mask.shape[1]):
            observe_mask[b, a] = is_last if a < egos else next_due[b, a] <= step[b] + 1


@kernel
def join_events(
    bits: Ints,
    terminated: Bools,
    truncated: Bools,
    running: Bools,
    new_bits: Ints,
    new_terminated: Bools,
    new_truncated: Bools,
    finished: Bools,
    pending: Bools,
) -> int:
    """Add one step's events of the egos to those of the decision.

    Args:
        bits: Of the decision, shape (B, N), written, as `terminated` and `truncated`.
        terminated: See `Events`.
        truncated: See `Events`.
        running: Whose episode is going on, shape (B,), written.
        new_bits: Of the step, shape (B, A), as `new_terminated` and `new_truncated`.
        new_terminated: See `Events`.
        new_truncated: See `Events`.
        finished: Whose episode has ended with the step, shape (B,).
        pending: Who makes the decision, shape (B,), written.

    Returns:
        How many are left to make the next step of it.
    """
    left = 0
    for b in range(len(finished)):
        for a in range(bits.shape[1]):
            bits[b, a] |= new_bits[b, a]
            terminated[b, a] |= new_terminated[b, a]
            truncated[b, a] |= new_truncated[b, a]
        if finished[b]:
            running[b] = pending[b] = False
        left += pending[b]
    return left
