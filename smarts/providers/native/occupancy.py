"""Kernels that list which vehicles are on each lane of one simulation, in order from the rear."""

from __future__ import annotations

import math

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.providers.native.driving import desired_speed
from smarts.providers.native.state import TAILS, Car, Traffic
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.kernels import centre_at, place_on_map

LEAN = 0.2
"""A vehicle is on the lane beside, too, if it reaches farther over the line [m]."""
LEAST_GAP = 2.5
"""Gap between two vehicles that stand [m]."""
BESIDE = 1.0
"""A vehicle of another provider is on a lane if its centre is at most so far beside the lane's area [m]."""
_ROAD = sum(1 << kind for kind in ROAD_LANES)


@kernel
def is_driven(n: Traffic, b: int, slot: int) -> bool:
    """Return whether the engine drives the vehicle in a slot."""
    v = n.vehicles
    return v.alive[b, slot] and v.owner[b, slot] == n.owner and n.driven[b, slot] == v.generation[b, slot]


@kernel
def list_vehicles(n: Traffic, b: int, others: bool) -> None:
    """List the vehicles of a simulation; those of other providers if `others`."""
    clear_lists(n, 0)
    if others:
        for slot in range(n.driven.shape[1]):
            if n.vehicles.alive[b, slot] and not is_driven(n, b, slot):
                _list_other(n, b, slot)
    n.counts[1] = n.counts[0]
    list_driven(n, b)


@kernel
def list_driven(n: Traffic, b: int) -> None:
    """List the engine's vehicles again, after those of other providers, which stay listed."""
    clear_lists(n, n.counts[1])
    sort_cars(n, b)
    for place in range(n.sims[b].listed):
        _list_car(n, n.cars[n.order[b, place]])


@kernel
def sort_cars(n: Traffic, b: int) -> None:
    """Sort the engine's vehicles by how far they are on their lanes; they nearly are from the last step."""
    order, sim, count = n.order[b], n.sims[b], 0
    for place in range(sim.listed):
        car = n.cars[order[place]]
        if not is_driven(n, b, car.slot):
            continue
        before = count - 1
        while before >= 0 and n.cars[order[before]].front < car.front:
            order[before + 1] = order[before]
            before -= 1
        order[before + 1] = car.place
        count += 1
    sim.listed = count


@kernel
def _list_car(n: Traffic, car: Car) -> None:
    """List a vehicle of the engine on its lane, on those of its tail, and on the other one of a change."""
    lane = n.lanes[car.lane]
    car.desired = desired_speed(n, car, lane)
    add_entry(n, car.lane, car.place, car.front, car.front - car.length, car.speed)
    place = car.front
    for tail in range(TAILS):
        behind = car.tails[tail]
        if place >= car.length or behind < 0:
            break
        place += n.lanes[behind].length
        add_entry(n, behind, car.place, place, place - car.length, car.speed)
    beside = lane_beside(n, car)
    if beside >= 0:
        there = car.front * n.lanes[beside].length / lane.length
        add_entry(n, beside, car.place, there, there - car.length, car.speed)


@kernel
def lane_beside(n: Traffic, car: Car) -> int:
    """Return the other lane that a vehicle of the engine is on, -1 for none."""
    lane, side = n.lanes[car.lane], car.side
    if side != 0:
        side = side if car.done < 0.5 else -side
    else:
        over = abs(car.offset) + 0.5 * car.width
        if over <= 0.5 * lane.width + LEAN:
            return -1
        side = 1 if car.offset > 0.0 else -1
    return int(lane.left if side > 0 else lane.right)


@kernel
def _list_other(n: Traffic, b: int, slot: int) -> None:
    """List a vehicle of another provider on all lanes that it lies on, by its pose."""
    v, roads, m = n.vehicles, n.roads, n.map[b]
    car = n.cars[b * n.driven.shape[1] + slot]
    car.is_own, car.type, car.lane, car.links = False, n.sims[b].stranger, -1, 0
    car.length, car.width = v.length[b, slot], v.width[b, slot]
    car.speed, car.acceleration = max(v.speed[b, slot], 0.0), v.acceleration[b, slot]
    x, y, heading = v.position[b, slot, 0], v.position[b, slot, 1], v.heading[b, slot]
    lane, s, t, distance, _ = place_on_map(
        roads, n.no_routes, m, x, y, v.height[b, slot], heading, -1, _ROAD, n.room
    )
    if lane < 0:
        return
    number = lane + roads.lane_base[m]
    here = n.lanes[number]
    half_road = 0.5 * here.width
    if distance > half_road + BESIDE:
        return
    point = segment_at(roads.point_s, roads.point_start[number], roads.point_start[number + 1], s)
    turn = heading - centre_at(roads, point, s)[2]
    along, across = abs(math.cos(turn)), abs(math.sin(turn))
    half = 0.5 * (car.length * along + car.width * across)
    aside = 0.5 * (car.length * across + car.width * along)
    pace = max(car.speed * math.cos(turn), 0.0)
    car.lane, car.front = number, s + half
    _add_with_ends(n, car, 2.0 * half, pace)
    if t + aside > half_road + LEAN and here.left >= 0:
        add_entry(n, here.left, car.place, s + half, s - half, pace)
    if aside - t > half_road + LEAN and here.right >= 0:
        add_entry(n, here.right, car.place, s + half, s - half, pace)
    # A vehicle in a junction is there since its first step in it.
    if not here.inside:
        car.entered = car.conflicted = np.inf
    elif car.conflicted == np.inf:
        car.entered = car.conflicted = n.sims[b].tick * n.dt


@kernel
def _add_with_ends(n: Traffic, car: Car, length: float, pace: float) -> None:
    """List a vehicle on its lane, on those behind for its tail, and on those ahead for its front."""
    lane, front = n.lanes[car.lane], car.front
    add_entry(n, car.lane, car.place, front, front - length, pace)
    if front < length:
        for place in range(lane.predecessors, n.lanes[car.lane + 1].predecessors):
            there = front + n.lanes[n.predecessor[place]].length
            add_entry(n, n.predecessor[place], car.place, there, there - length, pace)
    if front > lane.length:
        for place in range(lane.successors, n.lanes[car.lane + 1].successors):
            if may_take(n, car, n.successor[place]):
                there = front - lane.length
                add_entry(n, n.successor[place], car.place, there, there - length, pace)


@kernel
def may_take(n: Traffic, car: Car, lane: int) -> bool:
    """Return whether a vehicle of another provider may drive into a lane: its turn signal says, if any."""
    edge = n.vehicles.next_edge[car.sim, car.slot]
    return edge < 0 or n.lanes[lane].leads == edge + n.roads.edge_base[n.map[car.sim]]


@kernel
def add_entry(n: Traffic, lane: int, place: int, front: float, back: float, speed: float) -> None:
    """List a vehicle on a lane."""
    number = n.counts[0]
    if number < len(n.entries):
        n.counts[0] = number + 1
        entry = n.entries[number]
        entry.lane, entry.car, entry.front, entry.back, entry.speed = lane, place, front, back, speed
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
