"""Phases of the vehicles that agents hold in bubbles, as arrays: kernels over B simulations and A agents."""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.bubbles.membranes import BubbleRows, Membranes
from smarts.bubbles.outlines import BubbleTable, Place
from smarts.geometry.compiling import kernel
from smarts.types import columns
from smarts.types.agent_states import AgentStatus
from smarts.types.bubbles import BubbleStates
from smarts.types.world import State

IN_TIME = 1
"""How many steps after its bumper was in the zone a vehicle is still taken."""


class Phase(enum.IntEnum):
    """The phase of a vehicle in a bubble."""

    NONE = 0
    """No agent holds it."""
    AIRLOCK = 1
    """The agent observes it, traffic drives."""
    DRIVEN = 2
    """The agent drives."""
    RELEASING = 3
    """It goes back to traffic as soon as it can."""


_NONE, _AIRLOCK, _DRIVEN, _RELEASING = (int(each) for each in Phase)
_OUTSIDE, _ZONE = int(Place.OUTSIDE), int(Place.ZONE)
_SHADOWING, _ACTIVE = int(AgentStatus.SHADOWING), int(AgentStatus.ACTIVE)


_NONE_IS_MINUS_ONE = ("bubble", "number", "slot", "generation", "waits_since")


class Holds(NamedTuple):
    """The vehicles that agents hold in bubbles, by the agent's column, shape (B, A)."""

    bubble: Ints
    """Number of the bubble in its simulation, -1 for none."""
    number: Ints
    """Number of the agent in its episode."""
    slot: Ints
    """The vehicle's."""
    generation: Ints
    """The vehicle's."""
    phase: Bytes
    """A `Phase`."""
    is_released: Bools
    """Whether the bubble has set `release_step`."""
    has_collided: Bools
    """Whether the vehicle's collision is counted."""
    wants_take: Bools
    """Whether the agent is to drive."""
    wants_drop: Bools
    """Whether the agent is to stop to observe."""
    waits_since: Ints
    """Step since which it wants to drive, or in which that was tried last; -1 if it does not."""
    left: Bools
    """Whether a learning agent's vehicle has left its bubble."""

    @classmethod
    def allocate(cls, worlds: int, agents: int) -> Holds:
        """Return B simulations of A agents that hold no vehicles."""
        return columns.allocate(cls, (worlds, agents), _NONE_IS_MINUS_ONE)

    def clear(self, row: int, agent_id: int | slice = slice(None)) -> None:
        """Forget the holds of some columns of one simulation."""
        columns.clear(self, (row, agent_id), _NONE_IS_MINUS_ONE)


@kernel
def phase_of(status: int, release_step: int) -> int:
    """Return the phase of a vehicle that an agent of a status holds."""
    if status == _SHADOWING:
        return _AIRLOCK
    return _DRIVEN if status == _ACTIVE and release_step < 0 else _RELEASING


@kernel
def end_holds(state: State, holds: Holds, membranes: Membranes, env_mask: Bools) -> None:
    """Forget the holds of agents that have given up their vehicle.

    A vehicle that is still there is refused until it has left the margin.
    """
    agents, vehicles = state.agents, state.vehicles
    for b in np.flatnonzero(env_mask):
        for a in range(holds.bubble.shape[1]):
            z, v = holds.bubble[b, a], holds.slot[b, a]
            if z < 0:
                continue
            is_held = (
                agents.agent[b, a] == holds.number[b, a]
                and agents.slot[b, a] == v
                and agents.generation[b, a] == holds.generation[b, a]
            )
            if is_held:
                continue
            if v >= 0 and vehicles.alive[b, v] and vehicles.generation[b, v] == holds.generation[b, a]:
                membranes.refused[b, z, v] = True
            holds.bubble[b, a], holds.phase[b, a] = -1, _NONE
            holds.wants_take[b, a], holds.wants_drop[b, a], holds.left[b, a] = False, False, False


@kernel
def judge_holds(
    state: State,
    table: BubbleTable,
    rows: BubbleRows,
    membranes: Membranes,
    states: BubbleStates,
    holds: Holds,
    env_mask: Bools,
    wishes: Ints,
) -> None:
    """Write the phases of the vehicles that agents hold, and which of them are to change hands.

    `wishes`, shape (B,), gets the number of agents that want to begin to drive or stop to observe. An agent
    whose vehicle is outside the zone, or whose bubble is not active, gets a `release_step`; in a bubble of
    learning agents `left` is written instead.
    """
    for b in range(len(env_mask)):
        wishes[b] = 0
        if not env_mask[b] or rows.size[b] == 0:
            continue
        for a in range(holds.bubble.shape[1]):
            if holds.bubble[b, a] >= 0:
                learns = table.learns[rows.first[b] + holds.bubble[b, a]]
                _judge(state, membranes, states, holds, learns, b, a)
                wishes[b] += holds.wants_take[b, a] + holds.wants_drop[b, a]


@kernel
def _judge(
    state: State, membranes: Membranes, states: BubbleStates, holds: Holds, learns: bool, b: int, a: int
) -> None:
    """Write the phase of one hold; see `judge_holds`."""
    agents, z, v = state.agents, holds.bubble[b, a], holds.slot[b, a]
    status, wants_take, wants_drop, left = agents.state[b, a], False, False, False
    if status == _SHADOWING:
        wants_take, wants_drop = _judge_shadow(state, states, membranes, b, a, z, v)
    elif status == _ACTIVE:
        states.taken[b, z] += holds.phase[b, a] in (_NONE, _AIRLOCK)
        is_inside = membranes.here[b, z, v] == _ZONE and states.is_active[b, z]
        if learns:
            left = not is_inside
        else:
            _judge_driver(state, holds, is_inside, b, a)
    if agents.harmed[b, a] and not holds.has_collided[b, a]:
        holds.has_collided[b, a] = True
        states.collided[b, z] += 1
    if not wants_take:
        holds.waits_since[b, a] = -1
    elif holds.waits_since[b, a] < 0:
        holds.waits_since[b, a] = state.step[b]
    holds.phase[b, a] = phase_of(status, agents.release_step[b, a])
    holds.wants_take[b, a], holds.wants_drop[b, a], holds.left[b, a] = wants_take, wants_drop, left


@kernel
def _judge_shadow(
    state: State, states: BubbleStates, membranes: Membranes, b: int, a: int, z: int, v: int
) -> tuple[bool, bool]:
    """Return whether an agent that observes is to drive, and whether it is to stop to observe."""
    if not states.is_active[b, z] or state.agents.release_step[b, a] >= 0:
        return False, True
    entered = membranes.entered[b, z, v]
    is_in_time = entered >= 0 and state.step[b] - entered <= IN_TIME
    return is_in_time, not is_in_time and membranes.here[b, z, v] == _OUTSIDE


@kernel
def _judge_driver(state: State, holds: Holds, is_inside: bool, b: int, a: int) -> None:
    """Write since when an agent's vehicle is to go back; no longer if the vehicle is inside again."""
    release_step = state.agents.release_step
    if is_inside and holds.is_released[b, a]:
        release_step[b, a], holds.is_released[b, a] = -1, False
    elif not is_inside and release_step[b, a] < 0:
        release_step[b, a], holds.is_released[b, a] = state.step[b], True
