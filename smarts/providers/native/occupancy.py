"""Kernels that list which vehicles are on each lane of one simulation, in order from the rear."""

from __future__ import annotations

import math

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.providers.native.state import TAILS, Demand, Traffic
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
    vehicles = n.state.vehicles
    return (
        vehicles.alive[b, slot]
        and vehicles.owner[b, slot] == n.owner
        and n.driven.generation[b, slot] == vehicles.generation[b, slot]
    )


@kernel
def list_vehicles(n: Traffic, d: Demand, b: int, others: bool) -> None:
    """List the vehicles of a simulation; those of other providers if `others`."""
    sort_vehicles(n, b)
    order = n.driven.order[b]
    for place in range(n.driven.listed[b, 0]):
        list_driven(n, d, b, order[place])
    n.occupancy.other_lane[:] = -1
    if others:
        for slot in range(len(order)):
            if n.state.vehicles.alive[b, slot] and not is_driven(n, b, slot):
                _list_other(n, b, slot)


@kernel
def sort_vehicles(n: Traffic, b: int) -> None:
    """Sort the engine's vehicles by how far they are on their lanes; they nearly are from the last step."""
    order, listed, front = n.driven.order[b], n.occupancy.listed, n.driven.front[b]
    count = 0
    listed[:] = False
    for place in range(n.driven.listed[b, 0]):
        slot = order[place]
        if is_driven(n, b, slot):
            order[count], listed[slot] = slot, True
            count += 1
    for slot in range(len(order)):
        if not listed[slot] and is_driven(n, b, slot):
            order[count] = slot
            count += 1
    n.driven.listed[b, 0] = count
    for place in range(1, count):
        slot, before = order[place], place - 1
        while before >= 0 and front[order[before]] < front[slot]:
            order[before + 1] = order[before]
            before -= 1
        order[before + 1] = slot


@kernel
def list_driven(n: Traffic, d: Demand, b: int, slot: int) -> None:
    """List a vehicle of the engine on its lane, on those of its tail, and on the other one of a change."""
    lane, front = d.ways.lane[n.driven.row[b, slot]], n.driven.front[b, slot]
    length, pace = n.state.vehicles.length[b, slot], n.state.vehicles.speed[b, slot]
    add_entry(n, lane, slot, front, front - length, pace)
    place = front
    for tail in range(TAILS):
        behind = n.driven.tails[b, slot, tail]
        if place >= length or behind < 0:
            break
        place += n.lane_length[behind]
        add_entry(n, behind, slot, place, place - length, pace)
    beside = lane_beside(n, b, slot, lane)
    if beside >= 0:
        there = front * n.lane_length[beside] / n.lane_length[lane]
        add_entry(n, beside, slot, there, there - length, pace)


@kernel
def lane_beside(n: Traffic, b: int, slot: int, lane: int) -> int:
    """Return the other lane that a vehicle of the engine is on, -1 for none."""
    side = n.driven.side[b, slot]
    if side != 0:
        side = side if n.driven.done[b, slot] < 0.5 else -side
    else:
        over = abs(n.driven.offset[b, slot]) + 0.5 * n.state.vehicles.width[b, slot]
        if over <= 0.5 * n.roads.lane_width[lane] + LEAN:
            return -1
        side = 1 if n.driven.offset[b, slot] > 0.0 else -1
    return int(n.roads.lane_left[lane] if side > 0 else n.roads.lane_right[lane])


@kernel
def _list_other(n: Traffic, b: int, slot: int) -> None:
    """List a vehicle of another provider on all lanes that it lies on, by its pose."""
    vehicles, roads, room = n.state.vehicles, n.roads, n.occupancy
    x, y, heading = vehicles.position[b, slot, 0], vehicles.position[b, slot, 1], vehicles.heading[b, slot]
    lanes = (room.lanes, room.points, room.squares)
    m, height = n.state.map[b], vehicles.height[b, slot]
    lane, s, t, distance, _ = place_on_map(roads, n.no_routes, m, x, y, height, heading, -1, _ROAD, lanes)
    if lane < 0:
        return
    lane += roads.lane_base[m]
    half_road = 0.5 * roads.lane_width[lane]
    if distance > half_road + BESIDE:
        return
    point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
    turn = heading - centre_at(roads, point, s)[2]
    along, across = abs(math.cos(turn)), abs(math.sin(turn))
    half = 0.5 * (vehicles.length[b, slot] * along + vehicles.width[b, slot] * across)
    aside = 0.5 * (vehicles.length[b, slot] * across + vehicles.width[b, slot] * along)
    pace = max(vehicles.speed[b, slot] * math.cos(turn), 0.0)
    _add_with_ends(n, b, slot, lane, s + half, 2.0 * half, pace)
    if t + aside > half_road + LEAN and roads.lane_left[lane] >= 0:
        add_entry(n, roads.lane_left[lane], slot, s + half, s - half, pace)
    if aside - t > half_road + LEAN and roads.lane_right[lane] >= 0:
        add_entry(n, roads.lane_right[lane], slot, s + half, s - half, pace)
    # A vehicle in a junction is there since its first step in it.
    if not roads.lane_inside[lane]:
        n.driven.entered[b, slot] = n.driven.conflicted[b, slot] = np.inf
    elif n.driven.conflicted[b, slot] == np.inf:
        n.driven.entered[b, slot] = n.driven.conflicted[b, slot] = n.tick[b] * n.state.dt
    room.other_lane[slot], room.other_front[slot] = lane, s + half


@kernel
def _add_with_ends(
    n: Traffic, b: int, slot: int, lane: int, front: float, length: float, pace: float
) -> None:
    """List a vehicle on a lane, on those behind it for its tail, and on those ahead for its front."""
    add_entry(n, lane, slot, front, front - length, pace)
    if front < length:
        for place in range(n.predecessor_start[lane], n.predecessor_start[lane + 1]):
            behind = n.predecessor[place]
            there = front + n.lane_length[behind]
            add_entry(n, behind, slot, there, there - length, pace)
    if front > n.lane_length[lane]:
        for place in range(n.successor_start[lane], n.successor_start[lane + 1]):
            ahead = n.successor[place]
            if may_take(n, b, slot, ahead):
                there = front - n.lane_length[lane]
                add_entry(n, ahead, slot, there, there - length, pace)


@kernel
def may_take(n: Traffic, b: int, slot: int, lane: int) -> bool:
    """Return whether a vehicle of another provider may drive into a lane: its turn signal says, if any."""
    edge = n.state.vehicles.next_edge[b, slot]
    return edge < 0 or n.lane_leads[lane] == edge + n.roads.edge_base[n.state.map[b]]


@kernel
def add_entry(n: Traffic, lane: int, slot: int, front: float, back: float, pace: float) -> None:
    """List a vehicle on a lane, behind all whose fronts are farther ahead."""
    room = n.occupancy
    entry = room.entries[0]
    if entry >= len(room.slot):
        return
    room.entries[0] = entry + 1
    room.lane[entry], room.slot[entry] = lane, slot
    room.front[entry], room.back[entry], room.pace[entry] = front, back, pace
    if front <= n.lane_length[lane]:
        room.taken[lane] += front - back + LEAST_GAP
    before, ahead = -1, room.head[lane]
    while ahead >= 0 and room.front[ahead] < front:
        before, ahead = ahead, room.next[ahead]
    room.next[entry] = ahead
    if before < 0:
        room.head[lane] = entry
    else:
        room.next[before] = entry


@kernel
def clear_lists(n: Traffic) -> None:
    """Empty the lanes' lists."""
    room = n.occupancy
    for entry in range(room.entries[0]):
        room.head[room.lane[entry]], room.taken[room.lane[entry]] = -1, 0.0
    room.entries[0] = 0


@kernel
def entry_ahead(n: Traffic, lane: int, s: float, slot: int) -> int:
    """Return the entry of the next vehicle whose front is ahead of a place on a lane [m], -1 for none.

    Of two whose fronts are side by side, the one with the higher slot leads.
    """
    room = n.occupancy
    entry = room.head[lane]
    while entry >= 0:
        if room.slot[entry] != slot and (
            room.front[entry] > s or (room.front[entry] == s and room.slot[entry] > slot)
        ):
            return int(entry)
        entry = room.next[entry]
    return -1


@kernel
def entry_behind(n: Traffic, lane: int, s: float, slot: int) -> int:
    """Return the entry of the next vehicle whose front is not ahead of a place on a lane [m], -1 for none."""
    room = n.occupancy
    entry, found = room.head[lane], -1
    while entry >= 0 and room.front[entry] <= s:
        if room.slot[entry] != slot and (room.front[entry] < s or room.slot[entry] < slot):
            found = int(entry)
        entry = room.next[entry]
    return found


@kernel
def rearmost(n: Traffic, lane: int, slot: int) -> int:
    """Return the entry of the last vehicle on a lane but for one, -1 for none."""
    room = n.occupancy
    entry = room.head[lane]
    while entry >= 0 and room.slot[entry] == slot:
        entry = room.next[entry]
    return int(entry)
