"""Kernels that let vehicles depart (SUMO's `MSInsertionControl` and `MSLane::isInsertionSuccess`)."""

from __future__ import annotations

import numpy as np

from smarts.dynamics import car_following as cf
from smarts.geometry.compiling import kernel
from smarts.providers.native.draws import FACTOR, HEADWAY, PLACE, TYPE, draw, exponential, normal
from smarts.providers.native.driving import desired_speed
from smarts.providers.native.junctions import is_first, light_of
from smarts.providers.native.occupancy import add_entry, clear_car, entry_ahead, entry_behind
from smarts.providers.native.state import Car, Record, Traffic
from smarts.types.traffic import Signal

TAIL_SLACK = 0.1
"""A vehicle departs with its tail so far behind its lane's begin [m]."""
TRIES = 20
"""Draws of a speed factor within its bounds."""
TAIL_AT_BEGIN, DRAWN = -1.0, -2.0
"""Places in flows that stand for "base" and "random"."""
_GO = int(Signal.GO)


@kernel
def depart(n: Traffic, b: int, time: float) -> None:
    """Let the vehicles depart whose time has come and that have room; `time` is since the warm-up began."""
    sim, alive = n.sims[b], 0
    for slot in range(n.used[b]):
        alive += n.vehicles.alive[b, slot]
    for number in range(sim.flows):
        pending, flow = n.pending[b, number], n.flows[sim.flow + number]
        while pending.next <= time and pending.next < flow.end:
            pending.waiting += 1
            headway = flow.headway
            if flow.is_random:
                headway *= exponential(sim.seed, number, pending.came + pending.waiting, HEADWAY)
            pending.next += headway
        if pending.waiting == 0:
            continue
        if alive >= min(sim.limit, n.driven.shape[1]):
            sim.is_full = True
        elif _depart_one(n, b, number, flow):
            pending.waiting -= 1
            pending.came += 1
            alive += 1


@kernel
def _depart_one(n: Traffic, b: int, number: int, flow: Record) -> bool:
    """Let the next vehicle of a flow depart into the lowest free slot; return whether it has room."""
    v, sim, count, slot = n.vehicles, n.sims[b], n.pending[b, number].came, 0
    while v.alive[b, slot]:
        slot += 1
    chosen, share = flow.first, draw(sim.seed, number, count, TYPE)
    while chosen < flow.last and n.shares[chosen].until <= share:
        chosen += 1
    t = n.shares[chosen].type
    kind, lane, front = n.types[t], n.lanes[n.ways[flow.row].lane], flow.place
    factor = kind.factor_mean
    if kind.factor_deviation > 0.0:
        for attempt in range(TRIES):
            found = factor + kind.factor_deviation * normal(sim.seed, number, TRIES * count + attempt, FACTOR)
            if kind.factor_least <= found <= kind.factor_most:
                factor = found
                break
    if front == TAIL_AT_BEGIN:
        front = min(kind.length + TAIL_SLACK, lane.length)
    elif front == DRAWN:
        front = draw(sim.seed, number, sim.tick, PLACE) * lane.length
    car = n.by_slot[b, slot]
    prepare_car(n, car, t, flow.row, front, factor)
    car.length, car.width = kind.length, kind.width
    wanted = min(car.desired, flow.speed) if flow.speed >= 0.0 else car.desired
    car.speed = _insertion_speed(n, car, wanted)
    if car.speed < 0.0 or car.speed < flow.speed or not _is_free_behind(n, car):
        return False
    v.alive[b, slot] = True
    n.used[b] = max(n.used[b], slot + 1)
    v.generation[b, slot] += 1
    v.owner[b, slot] = v.home[b, slot] = n.owner
    v.kind[b, slot] = kind.kind
    v.length[b, slot], v.width[b, slot] = kind.length, kind.width
    v.route[b, slot] = n.route_number[b, n.ways[flow.row].route - sim.route]
    begin_driving(n, car)
    add_entry(n, car.lane, car, front, car.length, car.speed)
    return True


@kernel
def _insertion_speed(n: Traffic, car: Car, speed: float) -> float:
    """Return the highest safe speed of a vehicle that departs, up to a given one; -1 without room [m/s]."""
    kind, row, number = n.types[car.type], car.row, car.lane
    ahead, seen = entry_ahead(n, number, car.front, car), n.lanes[number].length - car.front
    while True:
        way = n.ways[row]
        if ahead >= 0:
            entry = n.entries[ahead]
            room = seen - n.lanes[number].length + entry.back - kind.min_gap
            if room < 0.0:
                return -1.0
            its = n.types[n.cars[entry.car].type].decel
            room += cf.brake_gap(kind, entry.speed, max(kind.decel, its), 0.0)
            return min(speed, cf.insertion_stop_speed(kind, room))
        reach = speed * kind.tau + 0.5 * speed * speed / kind.decel + kind.min_gap
        if seen > reach or way.arrival < np.inf:
            return speed
        if way.next < 0:
            return min(speed, cf.insertion_stop_speed(kind, seen))
        number = n.ways[way.next].lane
        target = n.lanes[number]
        if not is_first(target) or light_of(target) not in (0, _GO):
            return min(speed, cf.insertion_stop_speed(kind, seen))
        limit = desired_speed(n, car, target)
        speed = min(speed, max(limit, cf.free_speed(kind, speed, limit, seen, 0.0)))
        row, ahead = way.next, entry_ahead(n, number, -np.inf, car)
        seen += target.length


@kernel
def _is_free_behind(n: Traffic, car: Car) -> bool:
    """Return whether the vehicle behind one that departs has its gap."""
    behind = entry_behind(n, car.lane, car.front, car)
    if behind < 0:
        return True
    entry = n.entries[behind]
    kind = n.types[n.cars[entry.car].type]
    gap = car.front - car.length - entry.front - kind.min_gap
    return gap >= cf.secure_gap(kind, entry.speed, car.speed, n.types[car.type].decel)


@kernel
def prepare_car(n: Traffic, car: Car, t: int, row: int, front: float, factor: float) -> None:
    """Make a new driver of a type for a vehicle at a place on its way."""
    clear_car(n, car)
    car.type, car.row, car.lane, car.front, car.factor = t, row, n.ways[row].lane, front, factor
    car.desired = desired_speed(n, car, n.lanes[car.lane])


@kernel
def begin_driving(n: Traffic, car: Car) -> None:
    """Begin to drive a vehicle whose driver is prepared."""
    sim = n.sims[car.sim]
    n.driven[car.sim, car.slot] = car.last = n.vehicles.generation[car.sim, car.slot]
    car.driver, car.number = car.type, sim.born
    sim.born += 1
