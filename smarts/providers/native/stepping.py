"""The kernels of a step of native traffic, for all simulations."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Bools, Ints
from smarts.geometry.compiling import kernel
from smarts.providers.native import changing, departing, junctions, moving, occupancy, planning
from smarts.providers.native.draws import HEADWAY, exponential
from smarts.providers.native.driving import follow
from smarts.providers.native.state import Traffic
from smarts.types.transfers import Refusal

BRAKING = 4.5
"""A vehicle is not taken where its driver would brake harder [m/s^2]."""
_NONE, _SPEED, _SIDEWAYS = int(Refusal.NONE), int(Refusal.SPEED), int(Refusal.SIDEWAYS)
_MINOR = int(Refusal.WITHOUT_PRIORITY)


@kernel
def step(n: Traffic, env_mask: Bools) -> None:
    """Advance the simulations in a mask, shape (B,), by a step."""
    for b in range(len(env_mask)):
        if env_mask[b]:
            _step(n, b, True)
            for slot in range(n.used[b]):
                if n.driven[b, slot] >= 0:
                    moving.write_pose(n, n.by_slot[b, slot], n.by_slot[b, slot].next_action == -math.inf)


@kernel
def begin(n: Traffic, b: int, steps: int) -> None:
    """Begin an episode: drive the steps of the warm-up, without other providers' vehicles."""
    sim = n.sims[b]
    sim.tick = sim.born = 0
    sim.is_full = False
    n.driven[b, :] = -1
    for number in range(sim.flows):
        pending, flow = n.pending[b, number], n.flows[sim.flow + number]
        pending.waiting = pending.came = 0
        pending.next = flow.begin
        if flow.is_random:
            pending.next += flow.headway * exponential(sim.seed, number, 0, HEADWAY)
    junctions.begin_lights(n, b)
    for _ in range(steps):
        _step(n, b, False)
    for slot in range(n.used[b]):
        if n.driven[b, slot] >= 0:
            moving.write_pose(n, n.by_slot[b, slot], True)


@kernel
def _step(n: Traffic, b: int, others: bool) -> None:
    """Advance one simulation, in SUMO's order; `others`: other providers' vehicles are there."""
    sim, slots = n.sims[b], n.used[b]
    # The time at which SUMO's step begins; the slack is against rounding.
    time = sim.tick * n.dt + 1e-9
    sim.tick += 1
    occupancy.list_vehicles(n, b, others)
    junctions.switch_lights(n, b, time)
    junctions.show_lights(n, b, time)
    for slot in range(slots):
        if n.driven[b, slot] >= 0:
            car = n.by_slot[b, slot]
            planning.plan(n, car)
            planning.check_room(n, car)
            planning.register(n, car)
        elif others and n.vehicles.alive[b, slot]:
            planning.register_other(n, n.by_slot[b, slot])
    for slot in range(slots):
        if n.driven[b, slot] >= 0:
            moving.decide(n, n.by_slot[b, slot])
    for slot in range(slots):
        if n.driven[b, slot] >= 0 or (others and n.vehicles.alive[b, slot]):
            planning.withdraw_all(n, n.by_slot[b, slot])
        if n.driven[b, slot] >= 0:
            moving.move(n, n.by_slot[b, slot])
    occupancy.list_driven(n, b)
    changing.change_lanes(n, b)
    departing.depart(n, b, time)


@kernel
def find_new(n: Traffic, env_mask: Bools, rows: Ints, slots: Ints) -> int:
    """Forget vehicles that others drive now, list vehicles new to the engine, and return their number."""
    v, count = n.vehicles, 0
    for b in range(len(env_mask)):
        for slot in range(n.used[b]):
            if env_mask[b] and not occupancy.is_driven(n, b, slot):
                n.driven[b, slot] = -1
                if v.alive[b, slot] and v.owner[b, slot] == n.owner:
                    rows[count], slots[count] = b, slot
                    count += 1
    return count


@kernel
def take_over(
    n: Traffic, b: int, slot: int, t: int, row: int, front: float, offset: float, factor: float
) -> None:
    """Begin to drive a vehicle that another provider has driven; its tail may be on the lane before.

    Args:
        n: Native traffic.
        b: The simulation.
        slot: The vehicle.
        t: Its type.
        row: Row of its lane.
        front: Arc length of its front on it [m].
        offset: Offset to the left of the lane [m].
        factor: Its speed factor.
    """
    car, v = n.by_slot[b, slot], n.vehicles
    departing.prepare_car(n, car, t, row, front, factor)
    car.length, car.width, car.speed = v.length[b, slot], v.width[b, slot], max(v.speed[b, slot], 0.0)
    car.acceleration, car.offset, car.next_action = v.acceleration[b, slot], offset, 0.0
    departing.begin_driving(n, car)
    before = n.lanes[car.lane].predecessors
    if front < car.length and before < n.lanes[car.lane + 1].predecessors:
        car.tails[0] = n.predecessor[before]


@kernel
def would_brake(n: Traffic, b: int, slot: int, row: int, front: float, t: int, factor: float) -> int:
    """Return `Refusal.SPEED` if a driver would have to brake hard for its leader; see `take_over`."""
    occupancy.list_vehicles(n, b, True)
    car, kind, way = n.by_slot[b, slot], n.types[t], n.ways[row]
    lane, number = n.lanes[way.lane], way.lane
    seen, ahead = -front, occupancy.entry_ahead(n, number, front, car)
    if ahead < 0 and way.next >= 0:
        seen += lane.length
        number = n.ways[way.next].lane
        ahead = occupancy.entry_ahead(n, number, -np.inf, car)
    if ahead < 0:
        return _NONE
    before, entry = car.type, n.entries[ahead]
    car.type, car.desired = t, min(lane.speed * factor, kind.max_speed)
    gap = seen + entry.back - kind.min_gap
    safe = follow(n, car, gap, car.speed, n.cars[entry.car], entry.speed)
    car.type = before
    return _SPEED if safe < car.speed - max(BRAKING, kind.decel) * n.dt else _NONE


@kernel
def refusal_to_give(n: Traffic, b: int, slot: int) -> int:
    """Return why an agent cannot take a vehicle now: it changes lanes, or crosses without priority."""
    if not occupancy.is_driven(n, b, slot):
        return _NONE
    car = n.by_slot[b, slot]
    if car.side != 0:
        return _SIDEWAYS
    junctions.show_lights(n, b, n.sims[b].tick * n.dt)
    lane, following = n.lanes[car.lane], n.ways[car.row].next
    if lane.inside:
        return _NONE if junctions.is_first(lane) else _MINOR
    needed = 0.5 * car.speed * car.speed / BRAKING + n.dt * car.speed
    if lane.length - car.front < needed and following >= 0:
        return _NONE if junctions.is_first(n.lanes[n.ways[following].lane]) else _MINOR
    return _NONE
