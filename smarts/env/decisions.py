"""Kernels of the loop around the step.

Axis letters: B simulations, A agents, E egos.
"""

from __future__ import annotations

from smarts.arrays import Bools, Bytes, Ints
from smarts.geometry.compiling import kernel
from smarts.types.agent_states import AgentStatus

_SHADOWING = int(AgentStatus.SHADOWING)


@kernel
def choose_observed(
    state: Bytes, next_due: Ints, step: Ints, egos: int, observe_mask: Bools, is_last: bool
) -> None:
    """Write which agents the coming step observes: egos after the last of a decision, others when due.

    Agents that watch a vehicle in the air-lock are always observed: they may be asked in any step.
    """
    for b in range(observe_mask.shape[0]):
        for a in range(observe_mask.shape[1]):
            is_due = next_due[b, a] <= step[b] + 1 or state[b, a] == _SHADOWING
            observe_mask[b, a] = is_last if a < egos else is_due


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
    """Add one step's events of the egos to the decision's.

    Args:
        bits: Bits of the decision, shape (B, E), written, as `terminated` and `truncated`.
        terminated: See `Events`.
        truncated: See `Events`.
        running: Simulations whose episode is not over, shape (B,), written.
        new_bits: Bits of the step, shape (B, A), as `new_terminated` and `new_truncated`.
        new_terminated: See `Events`.
        new_truncated: See `Events`.
        finished: Simulations whose episode has ended with the step, shape (B,).
        pending: Simulations that make the decision, shape (B,), written.

    Returns:
        How many simulations are to make the next step of it.
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
