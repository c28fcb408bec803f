"""Where vehicles are relative to bubbles, as arrays: kernels over B simulations, Z bubbles and V vehicles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.bubbles.outlines import BubbleTable, Place, bubble_pose, deepest_on, place_of
from smarts.geometry.compiling import kernel
from smarts.roads.lane_graph import HEIGHT_REACH
from smarts.roads.levels import meets
from smarts.types import columns
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import BubbleStates
from smarts.types.vehicles import Owner, VehicleStates
from smarts.types.world import State

_OUTSIDE, _MARGIN, _ZONE = int(Place.OUTSIDE), int(Place.MARGIN), int(Place.ZONE)
_NOBODY, _AGENT = int(Owner.NOBODY), int(Owner.AGENT)


class BubbleRows(NamedTuple):
    """The bubbles of the table that each simulation has, and what they follow."""

    first: Ints
    """The first one's number in the table, shape (B,)."""
    size: Ints
    """How many, shape (B,)."""
    followed: Ints
    """Slot of the vehicle that each bubble follows, -1 for none, shape (B, Z)."""
    followed_generation: Ints
    """Generation of that vehicle, shape (B, Z)."""
    was_there: Bools
    """Whether it was there in the last step, shape (B, Z)."""

    @classmethod
    def allocate(cls, worlds: int, bubbles: int) -> BubbleRows:
        """Return B simulations without bubbles."""
        made = columns.allocate(cls, (worlds, bubbles), ("followed", "followed_generation"))
        return made._replace(first=np.zeros(worlds, np.int32), size=np.zeros(worlds, np.int32))


class Membranes(NamedTuple):
    """What each bubble knows of each vehicle, shape (B, Z, V) unless given."""

    generation: Ints
    """Generation of the vehicle that the columns are about, -1 for none, shape (B, V)."""
    front: Floats
    """Middle of its front bumper [m], shape (B, V, 2)."""
    old_front: Floats
    """The same one step ago; now, for a vehicle that has just appeared, shape (B, V, 2)."""
    here: Bytes
    """The `Place` of the bumper."""
    reached: Bytes
    """The deepest `Place` on its way in this step."""
    entered: Ints
    """Last step in which the bumper came or was in the zone, -1 for none."""
    refused: Bools
    """Whether the bubble does not take the vehicle until that has left the margin."""
    is_candidate: Bools
    """Whether the bubble may begin to observe the vehicle."""

    @classmethod
    def allocate(cls, worlds: int, bubbles: int, capacity: int) -> Membranes:
        """Return the membranes of B simulations with Z bubbles and V slots, without vehicles."""
        made = columns.allocate(cls, (worlds, bubbles, capacity), ("entered",))
        return made._replace(
            generation=np.full((worlds, capacity), UNSET, np.int32),
            front=np.zeros((worlds, capacity, 2)),
            old_front=np.zeros((worlds, capacity, 2)),
        )


@kernel
def move_bubbles(
    state: State, table: BubbleTable, rows: BubbleRows, states: BubbleStates, env_mask: Bools
) -> None:
    """Write the poses of bubbles that follow a vehicle; without one they keep their last pose."""
    for b in np.flatnonzero(env_mask):
        for z in range(rows.size[b]):
            slot = rows.followed[b, z]
            if slot >= 0:
                x, y, turn = _pose_in(state.vehicles, table, rows.first[b] + z, b, slot)
                states.pose[b, z, 0], states.pose[b, z, 1], states.pose[b, z, 2] = x, y, turn


@kernel
def place_vehicles(
    state: State,
    table: BubbleTable,
    rows: BubbleRows,
    membranes: Membranes,
    states: BubbleStates,
    env_mask: Bools,
    found: Ints,
) -> None:
    """Write where all vehicles are, which of them are candidates, and how many these are, shape (B,).

    A way leads from the place of the front bumper one step ago to its place now, both in the bubble's own
    frame of that time. Vehicles that have just appeared, and all vehicles in a step in which the followed
    vehicle has appeared, are at a point. A refusal ends outside the margin.

    A candidate is driven by traffic and held by no agent, and its front is in the margin, or has come into
    the zone in this step.
    """
    for b in range(len(env_mask)):
        found[b] = 0
        if not env_mask[b] or rows.size[b] == 0:
            continue
        used = _find_fronts(state, membranes, b, rows.size[b])
        for z in range(rows.size[b]):
            found[b] += _place_in(state, table, rows, membranes, states, used, b, z)


@kernel
def _find_fronts(state: State, membranes: Membranes, b: int, size: int) -> int:
    """Write the ways of all front bumpers, forget vehicles that are gone; return the number of used slots."""
    used = 0
    vehicles, front, old_front = state.vehicles, membranes.front, membranes.old_front
    for v in range(vehicles.alive.shape[1]):
        generation = vehicles.generation[b, v] if vehicles.alive[b, v] else -1
        is_new = generation != membranes.generation[b, v]
        if is_new:
            membranes.generation[b, v] = generation
            for z in range(size):
                _write(membranes, b, z, v, _OUTSIDE, _OUTSIDE, -1)
                membranes.entered[b, z, v] = -1
                membranes.is_candidate[b, z, v] = False
        if generation < 0:
            continue
        used = v + 1
        old_front[b, v, 0], old_front[b, v, 1] = front[b, v, 0], front[b, v, 1]
        heading, half = vehicles.heading[b, v], 0.5 * vehicles.length[b, v]
        front[b, v, 0] = vehicles.position[b, v, 0] + half * math.cos(heading)
        front[b, v, 1] = vehicles.position[b, v, 1] + half * math.sin(heading)
        if is_new:
            old_front[b, v, 0], old_front[b, v, 1] = front[b, v, 0], front[b, v, 1]
    return used


@kernel
def _place_in(
    state: State,
    table: BubbleTable,
    rows: BubbleRows,
    membranes: Membranes,
    states: BubbleStates,
    used: int,
    b: int,
    z: int,
) -> int:
    """Write where all vehicles are relative to a bubble; return how many are candidates."""
    n, slot, pose, before = rows.first[b] + z, rows.followed[b, z], states.pose[b, z], state.before
    moves, had_pose = table.moves[n], True
    old_x, old_y, old_turn = pose[0], pose[1], pose[2]
    if moves:
        had_pose = (
            slot >= 0
            and before.alive[b, slot]
            and before.generation[b, slot] == rows.followed_generation[b, z]
            and rows.was_there[b, z]
        )
        rows.was_there[b, z] = slot >= 0
        if had_pose:
            old_x, old_y, old_turn = _pose_in(before, table, n, b, slot)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    old_cos, old_sin = math.cos(old_turn), math.sin(old_turn)
    found = 0
    for v in range(used):
        if membranes.generation[b, v] < 0:
            continue
        if moves and slot < 0:
            _write(membranes, b, z, v, _OUTSIDE, _OUTSIDE, state.step[b])
            membranes.is_candidate[b, z, v] = False
            continue
        dx, dy = membranes.front[b, v, 0] - pose[0], membranes.front[b, v, 1] - pose[1]
        x, y = cos * dx + sin * dy, cos * dy - sin * dx
        from_x, from_y = x, y
        if had_pose:
            dx, dy = membranes.old_front[b, v, 0] - old_x, membranes.old_front[b, v, 1] - old_y
            from_x, from_y = old_cos * dx + old_sin * dy, old_cos * dy - old_sin * dx
        if moves:
            is_level = v == slot or meets(state.vehicles, b, slot, v)
        else:
            height, (low, high) = state.vehicles.height[b, v], table.heights[n]
            is_level = not (height < low - HEIGHT_REACH or height > high + HEIGHT_REACH)
        if _place(table, rows, membranes, b, z, v, from_x, from_y, x, y, is_level, state.step[b]):
            found += _judge_candidate(state, rows, membranes, states, b, z, v)
    return found


@kernel
def _place(
    table: BubbleTable,
    rows: BubbleRows,
    membranes: Membranes,
    b: int,
    z: int,
    v: int,
    from_x: float,
    from_y: float,
    x: float,
    y: float,
    is_level: bool,
    step: int,
) -> bool:
    """Write where a vehicle is, its way given in the bubble's coordinates; return whether it may be taken.

    On another level than the bubble's, it is outside.
    """
    n = rows.first[b] + z
    reached = deepest_on(table, n, from_x, from_y, x, y) if is_level else _OUTSIDE
    here = place_of(table, n, x, y) if reached > _OUTSIDE else _OUTSIDE
    _write(membranes, b, z, v, here, reached, step)
    membranes.is_candidate[b, z, v] = False
    return here >= _MARGIN or reached == _ZONE


@kernel
def _judge_candidate(
    state: State, rows: BubbleRows, membranes: Membranes, states: BubbleStates, b: int, z: int, v: int
) -> bool:
    """Write and return whether a bubble may begin to observe a vehicle that is where it should be."""
    is_open = states.is_active[b, z] and not membranes.refused[b, z, v] and v != rows.followed[b, z]
    is_candidate = is_open and _is_free(state, b, v)
    membranes.is_candidate[b, z, v] = is_candidate
    return is_candidate


@kernel
def _is_free(state: State, b: int, v: int) -> bool:
    """Return whether traffic drives a vehicle, and no agent holds it."""
    if state.vehicles.owner[b, v] in (_NOBODY, _AGENT):
        return False
    holders = 0
    for a in range(state.agents.slot.shape[1]):
        holders += state.agents.slot[b, a] == v
    return holders == 0


@kernel
def _pose_in(
    vehicles: VehicleStates, table: BubbleTable, number: int, b: int, slot: int
) -> tuple[float, float, float]:
    """Return the pose of a bubble that follows one of `vehicles`, now or before."""
    position = vehicles.position[b, slot]
    return bubble_pose(table, number, position[0], position[1], vehicles.heading[b, slot])


@kernel
def _write(membranes: Membranes, b: int, z: int, v: int, here: int, reached: int, step: int) -> None:
    """Write where a vehicle is, and has been on its way."""
    was_inside = membranes.here[b, z, v] == _ZONE
    if here == _ZONE or (reached == _ZONE and not was_inside):
        membranes.entered[b, z, v] = step
    if here == _OUTSIDE:
        membranes.refused[b, z, v] = False
    membranes.here[b, z, v], membranes.reached[b, z, v] = here, reached
