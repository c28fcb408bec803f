"""Kernels that list which vehicles are on each lane of one simulation, in order from the rear."""

from __future__ import annotations

import math

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.providers.native.driving import desired_speed
from smarts.providers.native.state import TAILS, Car, Traffic
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.kernels import place_on_map, pose_on_lane

LEAN, LEAST_LEAN = 0.2, 0.1
"""A vehicle is on the lane beside, too, if it reaches farther over the line [m]."""
LEAST_GAP = 2.5
"""Gap between two vehicles that stand [m]."""
BESIDE = 1.0
"""A vehicle of another provider is on a lane if its centre is at most so far beside the lane's area [m]."""
_ROAD = sum(1 << kind for kind in ROAD_LANES)


@kernel
def is_driven(n: Traffic, b: int, slot: int) -> bool:
    """Return whether the engine drives the vehicle in a slot, which may have changed hands meanwhile."""
    v = n.vehicles
    return v.alive[b, slot] and v.owner[b, slot] == n.owner and n.driven[b, slot] == v.generation[b, slot]


@kernel
def list_vehicles(n: Traffic, b: int, others: bool) -> None:
    """List the vehicles of a simulation; those of other providers if `others`."""
    clear_lists(n, 0)
    if others:
        for slot in range(n.used[b]):
            if n.vehicles.alive[b, slot] and not is_driven(n, b, slot):
                _list_other(n, b, slot)
    n.counts[1] = n.counts[0]
    list_driven(n, b)


@kernel
def list_driven(n: Traffic, b: int) -> None:
    """List the engine's vehicles again, after those of other providers, which stay listed."""
    clear_lists(n, n.counts[1])
    for slot in range(n.used[b]):
        if is_driven(n, b, slot):
            _list_car(n, n.by_slot[b, slot])


@kernel
def _list_car(n: Traffic, car: Car) -> None:
    """List a vehicle of the engine on its lane, on those of its tail, and on the other one of a change."""
    car.desired = desired_speed(n, car, n.lanes[car.lane])
    add_entry(n, car.lane, car, car.front, car.length, car.speed)
    place = car.front
    for tail in range(TAILS):
        behind = car.tails[tail]
        if place >= car.length or behind < 0:
            break
        place += n.lanes[behind].length
        add_entry(n, behind, car, place, car.length, car.speed)
    beside = lane_beside(n, car)
    if beside >= 0:
        there = car.front * n.lanes[beside].length / n.lanes[car.lane].length
        add_entry(n, beside, car, there, car.length, car.speed)


@kernel
def lane_beside(n: Traffic, car: Car) -> int:
    """Return the other lane that a vehicle of the engine is on, -1 for none."""
    lane = n.lanes[car.lane]
    if car.side != 0 and car.done < 0.5:
        return int(lane.left if car.side > 0 else lane.right)
    over = abs(car.offset) + 0.5 * (car.width - lane.width)
    if over <= (LEAST_LEAN if car.side != 0 else LEAN):
        return -1
    return int(lane.left if car.offset > 0.0 else lane.right)


@kernel
def place_of(n: Traffic, b: int, slot: int) -> tuple[int, float, float, float]:
    """Return a vehicle's lane by its pose, -1 for none, its place along and beside it, its angle [rad]."""
    v, roads, m = n.vehicles, n.roads, n.map[b]
    x, y, heading = v.position[b, slot, 0], v.position[b, slot, 1], v.heading[b, slot]
    found = place_on_map(roads, n.no_routes, m, x, y, v.height[b, slot], heading, -1, _ROAD, n.room)
    lane, s, t, distance = found[0] + roads.lane_base[m], found[1], found[2], found[3]
    if found[0] < 0 or distance > 0.5 * n.lanes[lane].width + BESIDE:
        return -1, 0.0, 0.0, 0.0
    return lane, s, t, wrapped(heading - pose_on_lane(roads, lane, s)[2])


@kernel
def clear_car(n: Traffic, car: Car) -> None:
    """Forget what is known of the vehicle in a slot."""
    place, slot, sim = car.place, car.slot, car.sim
    n.cars[place] = n.new_car[0]
    car.place, car.slot, car.sim = place, slot, sim


@kernel
def _list_other(n: Traffic, b: int, slot: int) -> None:
    """List a vehicle of another provider on all lanes that it lies on, by its pose."""
    v, car = n.vehicles, n.by_slot[b, slot]
    if car.last != v.generation[b, slot]:
        clear_car(n, car)
        car.last = v.generation[b, slot]
    car.is_own, car.type, car.links = False, n.sims[b].stranger, 0
    car.length, car.width = v.length[b, slot], v.width[b, slot]
    car.speed, car.acceleration = max(v.speed[b, slot], 0.0), v.acceleration[b, slot]
    car.lane, s, t, turn = place_of(n, b, slot)
    if car.lane < 0:
        return
    lane, along, across = n.lanes[car.lane], abs(math.cos(turn)), abs(math.sin(turn))
    half = 0.5 * (car.length * along + car.width * across)
    aside = 0.5 * (car.length * across + car.width * along)
    pace = max(car.speed * math.cos(turn), 0.0)
    car.front = s + half
    _add_with_ends(n, car, 2.0 * half, pace)
    if t + aside > 0.5 * lane.width + LEAN and lane.left >= 0:
        add_entry(n, lane.left, car, s + half, 2.0 * half, pace)
    if aside - t > 0.5 * lane.width + LEAN and lane.right >= 0:
        add_entry(n, lane.right, car, s + half, 2.0 * half, pace)
    # A vehicle in a junction is there since its first step in it.
    if not lane.inside:
        car.entered = car.conflicted = np.inf
    elif car.conflicted == np.inf:
        car.entered = car.conflicted = n.sims[b].tick * n.dt


@kernel
def _add_with_ends(n: Traffic, car: Car, length: float, pace: float) -> None:
    """List a vehicle on its lane, on those behind for its tail, and on those ahead for its front."""
    lane = n.lanes[car.lane]
    add_entry(n, car.lane, car, car.front, length, pace)
    if car.front < length:
        for place in range(lane.predecessors, n.lanes[car.lane + 1].predecessors):
            behind = n.predecessor[place]
            add_entry(n, behind, car, car.front + n.lanes[behind].length, length, pace)
    if car.front > lane.length:
        for place in range(lane.successors, n.lanes[car.lane + 1].successors):
            if may_take(n, car, n.successor[place]):
                add_entry(n, n.successor[place], car, car.front - lane.length, length, pace)


@kernel
def may_take(n: Traffic, car: Car, lane: int) -> bool:
    """Return whether a vehicle of another provider may drive into a lane: its turn signal says, if any."""
    edge = n.vehicles.next_edge[car.sim, car.slot]
    return bool(edge < 0 or n.lanes[lane].leads == edge + n.roads.edge_base[n.map[car.sim]])


@kernel
def add_entry(n: Traffic, lane: int, car: Car, front: float, length: float, speed: float) -> None:
    """List a vehicle on a lane."""
    number = n.counts[0]
    n.counts[0] = number + 1
    entry = n.entries[number]
    entry.lane, entry.car, entry.speed = lane, car.place, speed
    entry.front, entry.back = front, front - length
    _link_entry(n, number)


@kernel
def _link_entry(n: Traffic, number: int) -> None:
    """Put an entry into its lane's list, behind all whose fronts are farther ahead."""
    entry = n.entries[number]
    lane = n.lanes[entry.lane]
    if entry.front <= lane.length:
        lane.taken += entry.front - entry.back + LEAST_GAP
    before, ahead = -1, lane.head
    while ahead >= 0 and n.entries[ahead].front < entry.front:
        before, ahead = ahead, n.entries[ahead].next
    entry.next = ahead
    if before < 0:
        lane.head = number
    else:
        n.entries[before].next = number


@kernel
def clear_lists(n: Traffic, kept: int) -> None:
    """Empty the lanes' lists but for the first entries."""
    for number in range(n.counts[0]):
        lane = n.lanes[n.entries[number].lane]
        lane.head, lane.taken = -1, 0.0
    n.counts[0] = kept
    for number in range(kept):
        _link_entry(n, number)


@kernel
def entry_ahead(n: Traffic, lane: int, s: float, car: Car) -> int:
    """Return the entry of the next vehicle whose front is ahead of a place on a lane, -1 for none.

    Of two whose fronts are side by side, the one with the higher slot leads. All are ahead of -infinity.
    """
    found = n.lanes[lane].head
    while found >= 0:
        entry = n.entries[found]
        if entry.car != car.place and (entry.front > s or (entry.front == s and entry.car > car.place)):
            return int(found)
        found = entry.next
    return -1


@kernel
def entry_behind(n: Traffic, lane: int, s: float, car: Car) -> int:
    """Return the entry of the next vehicle whose front is not ahead of a place on a lane, -1 for none."""
    number, found = n.lanes[lane].head, -1
    while number >= 0:
        entry = n.entries[number]
        if entry.front > s:
            break
        if entry.car != car.place and (entry.front < s or entry.car < car.place):
            found = int(number)
        number = entry.next
    return found
