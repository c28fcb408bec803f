"""Where vehicles are relative to bubbles, as arrays: kernels over B simulations, Z bubbles and V vehicles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.bubbles.outlines import BubbleTable, Place, bubble_pose, deepest_on, place_of, to_file
from smarts.geometry.compiling import kernel
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import BubbleStates
from smarts.types.vehicles import Owner, VehicleStates
from smarts.types.world import State

_OUTSIDE, _MARGIN, _ZONE = int(Place.OUTSIDE), int(Place.MARGIN), int(Place.ZONE)
_NOBODY, _AGENT = int(Owner.NOBODY), int(Owner.AGENT)


class BubbleRows(NamedTuple):
    """Which bubbles of the table each simulation has, and what they follow."""

    first: Ints
    """The first one's number in the table, shape (B,)."""
    size: Ints
    """How many, shape (B,)."""
    followed: Ints
    """Slot of the vehicle that each bubble follows, -1 for none, shape (B, Z)."""
    followed_generation: Ints
    """That vehicle's generation, shape (B, Z)."""

    @classmethod
    def allocate(cls, worlds: int, bubbles: int) -> BubbleRows:
        """Return B simulations without bubbles."""
        return cls(
            first=np.zeros(worlds, np.int32),
            size=np.zeros(worlds, np.int32),
            followed=np.full((worlds, bubbles), UNSET, np.int32),
            followed_generation=np.full((worlds, bubbles), UNSET, np.int32),
        )


class Membranes(NamedTuple):
    """What each bubble knows of each vehicle, shape (B, Z, V) unless given."""

    generation: Ints
    """Of the vehicle that the columns are about, -1 for none, shape (B, V)."""
    here: Bytes
    """The `Place` of its front bumper."""
    reached: Bytes
    """The deepest `Place` on the bumper's way in this step."""
    entered: Ints
    """Last step in which the bumper came or was in the zone, -1 for none."""
    refused: Bools
    """Whether the bubble does not take the vehicle until that has left the margin."""
    is_candidate: Bools
    """Whether the bubble may begin to observe the vehicle."""

    @classmethod
    def allocate(cls, worlds: int, bubbles: int, capacity: int) -> Membranes:
        """Return the membranes of B simulations with Z bubbles and V slots, without vehicles."""
        shape = (worlds, bubbles, capacity)
        return cls(
            generation=np.full((worlds, capacity), UNSET, np.int32),
            here=np.zeros(shape, np.int8),
            reached=np.zeros(shape, np.int8),
            entered=np.full(shape, UNSET, np.int32),
            refused=np.zeros(shape, np.bool_),
            is_candidate=np.zeros(shape, np.bool_),
        )


@kernel
def move_bubbles(
    state: State, table: BubbleTable, rows: BubbleRows, states: BubbleStates, env_mask: Bools
) -> None:
    """Write the poses of bubbles that follow a vehicle; without one they keep their last pose."""
    for b in range(len(env_mask)):
        if not env_mask[b]:
            continue
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
) -> None:
    """Write where all vehicles are, and forget the refusals of those outside.

    A way leads from the place of the front bumper one step ago to its place now, both in the bubble's own
    frame of that time. Vehicles that have just appeared, and all vehicles in a step in which the followed
    vehicle has appeared, are at a point.
    """
    vehicles, before = state.vehicles, state.before
    for b in range(len(env_mask)):
        if not env_mask[b] or rows.size[b] == 0:
            continue
        for v in range(vehicles.alive.shape[1]):
            generation = vehicles.generation[b, v] if vehicles.alive[b, v] else -1
            if generation != membranes.generation[b, v]:
                _forget(membranes, b, v, rows.size[b])
                membranes.generation[b, v] = generation
            if generation < 0:
                continue
            x, y = _front(vehicles, b, v)
            was_there = before.alive[b, v] and before.generation[b, v] == generation
            old_x, old_y = _front(before, b, v) if was_there else (x, y)
            for z in range(rows.size[b]):
                n, slot = rows.first[b] + z, rows.followed[b, z]
                pose = states.pose[b, z]
                to_x, to_y, from_x, from_y = x, y, old_x, old_y
                if table.moves[n]:
                    to_x, to_y = to_file(x, y, pose[0], pose[1], pose[2])
                    from_x, from_y = to_x, to_y
                    was_followed = (
                        slot >= 0
                        and before.alive[b, slot]
                        and before.generation[b, slot] == rows.followed_generation[b, z]
                    )
                    if was_there and was_followed:
                        old_pose = _pose_in(before, table, n, b, slot)
                        from_x, from_y = to_file(old_x, old_y, old_pose[0], old_pose[1], old_pose[2])
                    if slot < 0:
                        _write(membranes, b, z, v, _OUTSIDE, _OUTSIDE, state.step[b])
                        continue
                reached = deepest_on(table, n, from_x, from_y, to_x, to_y)
                here = place_of(table, n, to_x, to_y) if reached > _OUTSIDE else _OUTSIDE
                _write(membranes, b, z, v, here, reached, state.step[b])


@kernel
def find_candidates(
    state: State, rows: BubbleRows, membranes: Membranes, states: BubbleStates, env_mask: Bools, found: Ints
) -> None:
    """Mark the vehicles that bubbles may begin to observe, and write their numbers, shape (B,).

    A candidate is driven by traffic and held by no agent, and its front is in the margin, or has come into
    the zone in this step.
    """
    vehicles = state.vehicles
    for b in range(len(env_mask)):
        found[b] = 0
        if not env_mask[b]:
            continue
        for z in range(rows.size[b]):
            for v in range(vehicles.alive.shape[1]):
                is_candidate = False
                if vehicles.alive[b, v] and states.is_active[b, z] and not membranes.refused[b, z, v]:
                    is_in = membranes.here[b, z, v] >= _MARGIN or membranes.reached[b, z, v] == _ZONE
                    if is_in and v != rows.followed[b, z] and _is_free(state, b, v):
                        is_candidate = True
                        found[b] += 1
                membranes.is_candidate[b, z, v] = is_candidate


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
def _front(vehicles: VehicleStates, b: int, v: int) -> tuple[float, float]:
    """Return the middle of a vehicle's front bumper [m]."""
    heading, half = vehicles.heading[b, v], 0.5 * vehicles.length[b, v]
    position = vehicles.position[b, v]
    return position[0] + half * math.cos(heading), position[1] + half * math.sin(heading)


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


@kernel
def _forget(membranes: Membranes, b: int, v: int, count: int) -> None:
    """Forget what bubbles know of a slot's vehicle."""
    for z in range(count):
        membranes.here[b, z, v], membranes.reached[b, z, v] = _OUTSIDE, _OUTSIDE
        membranes.entered[b, z, v] = -1
        membranes.refused[b, z, v] = False
