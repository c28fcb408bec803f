"""Kernels that plan a vehicle's step: speeds for each link ahead, requests (SUMO's `planMoveInternal`)."""

from __future__ import annotations

import numpy as np

from smarts.dynamics.car_following import SLACK, brake_gap, safe_stop_speed, soonest_arrival, speed_after
from smarts.geometry.compiling import kernel
from smarts.providers.native.driving import (
    ACCEL,
    DECEL,
    braking_distance,
    decel_of,
    desired_speed,
    follow_speed,
    highest_next,
    lowest_next,
    slow_to,
    stop_speed,
)
from smarts.providers.native.junctions import (
    heed_conflicts,
    ignores_light,
    is_first,
    is_waiting_lane,
    light_of,
)
from smarts.providers.native.occupancy import LEAST_GAP, entry_ahead, lane_beside, may_take, rearmost
from smarts.providers.native.state import LINKS, Demand, Traffic
from smarts.types.traffic import Signal

VISIBLE = 4.5
"""A driver without priority sees the others from this distance on [m]."""
LINE_GAP, CLOSE = 1.0, 0.1
"""Distances at which drivers stop before a line: before a light or with priority; without [m]."""
LIGHT_DECEL = 3.0
"""Deceleration for a light, at least [m/s^2]."""
LEAST_REQUEST = 1e-5
"""A slower vehicle does not ask to pass [m/s]."""
ROOM_AHEAD = 5.0
"""How far a driver looks behind a junction, in lengths of its vehicle."""
DURATION = 3.0
"""Duration of a lane change [s]."""
AGENTS_AHEAD = 60.0
"""Other providers' vehicles ask to pass links from this distance on [m]."""
_RED, _AMBER = int(Signal.STOP), int(Signal.CAUTION)


@kernel
def plan(n: Traffic, d: Demand, b: int, slot: int) -> None:
    """Write a vehicle's links ahead; the last one is where it stops, arrives, or does not look farther."""
    ways, types, links, driven = d.ways, d.types, n.links, n.driven
    t, row, dt, ballistic = driven.type[b, slot], driven.row[b, slot], n.state.dt, n.ballistic[b]
    speed, lane = max(n.state.vehicles.speed[b, slot], 0.0), ways.lane[row]
    length, front = n.state.vehicles.length[b, slot], driven.front[b, slot]
    most, comfortable = highest_next(types, t, speed, dt), lowest_next(types, t, speed, dt, ballistic)
    lane_most = max(desired_speed(n, d, b, slot, lane), comfortable)
    v = min(most, lane_most)
    reach = dt * most + braking_distance(n, d, b, slot, most, types.tau[t])
    seen = n.lane_length[lane] - front
    v_pass = min(speed_after(seen, v, types.accel[t], types.max_speed[t]), lane_most)
    outside, inside = 0.0, seen if n.roads.lane_inside[lane] else 0.0
    slowed, was_outside = False, False
    links.total[slot] = 0
    while True:
        v, v_pass = _heed_leaders(n, d, b, slot, row, seen, v, v_pass)
        last = links.total[slot] - 1
        if last >= 0:
            links.waiting[slot, last] = min(links.waiting[slot, last], v)
        following = ways.next[row]
        if following < 0 or last == LINKS - 2:
            if ways.arrival[row] < np.inf:
                left = seen + ways.arrival[row] - n.lane_length[lane] - dt * lane_most
                end = max(SLACK, slow_to(n, d, b, slot, speed, lane_most, left))
            else:
                end = stop_speed(n, d, b, slot, speed, seen, types.decel[t]) if following < 0 else v
            v = min(v, end)
            _leave_at_most(n, slot, last, end)
            _end_links(n, slot, v, seen)
            return
        v = _finish_change(n, d, b, slot, row, seen, v)
        slowed, stops = _add_link(n, d, b, slot, row, seen, v, v_pass, lane_most, slowed)
        if stops:
            return
        link = links.total[slot] - 1
        v, v_pass = links.speed[slot, link], min(v_pass, links.speed[slot, link])
        target = ways.lane[following]
        was_outside = was_outside or not n.roads.lane_inside[target]
        has_room = outside > max(ROOM_AHEAD * length, length + inside)
        if (not links.asks[slot, link] or v <= 0.0 or seen > reach) and was_outside and has_room:
            return
        row, lane = following, target
        lane_most = desired_speed(n, d, b, slot, lane)
        v = min(v, max(slow_to(n, d, b, slot, speed, lane_most, seen), comfortable))
        if n.roads.lane_inside[lane]:
            inside += n.lane_length[lane]
        else:
            outside += n.lane_length[lane]
        seen += n.lane_length[lane]
        v_pass = min(speed_after(n.lane_length[lane], v, types.accel[t], types.max_speed[t]), lane_most)


@kernel
def _end_links(n: Traffic, slot: int, v: float, seen: float) -> None:
    """Write the last link: not to be passed."""
    links, link = n.links, n.links.total[slot]
    links.row[slot, link], links.asks[slot, link] = -1, False
    links.speed[slot, link] = links.waiting[slot, link] = v
    links.distance[slot, link] = seen
    links.total[slot] = link + 1


@kernel
def _leave_at_most(n: Traffic, slot: int, link: int, speed: float) -> None:
    if link >= 0:
        n.links.leaving_speed[slot, link] = min(n.links.leaving_speed[slot, link], speed)


@kernel
def _heed_leaders(
    n: Traffic, d: Demand, b: int, slot: int, row: int, seen: float, v: float, v_pass: float
) -> tuple[float, float]:
    """Return speeds behind the vehicles ahead on a lane, and on the one beside during a lane change [m/s].

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        row: Row of the lane.
        seen: Distance to the lane's end [m].
        v: Highest speed after the step so far [m/s].
        v_pass: Highest speed at the lane's end so far [m/s].
    """
    lane, last = d.ways.lane[row], n.links.total[slot] - 1
    ahead = entry_ahead(n, lane, n.driven.front[b, slot], slot) if last < 0 else rearmost(n, lane, slot)
    if ahead >= 0:
        v, v_pass = _heed_leader(n, d, b, slot, lane, ahead, seen, v, v_pass)
    for place in range(n.sibling_start[lane], n.sibling_start[lane + 1]):
        v, v_pass = _heed_branching(n, d, b, slot, lane, place, seen, v, v_pass)
    if n.driven.side[b, slot] != 0:
        own = d.ways.lane[n.driven.row[b, slot]]
        other = lane_beside(n, b, slot, own)
        if other >= 0 and last >= 0:
            beside = d.ways.left[row] if (other == n.roads.lane_left[own]) else d.ways.right[row]
            other = d.ways.lane[beside] if beside >= 0 else -1
        if other >= 0:
            there = n.driven.front[b, slot] * n.lane_length[other] / n.lane_length[lane]
            ahead = entry_ahead(n, other, there, slot) if last < 0 else rearmost(n, other, slot)
            if ahead >= 0:
                scaled = seen if last >= 0 else n.lane_length[other] - there
                v, v_pass = _heed_leader(n, d, b, slot, other, ahead, scaled, v, v_pass)
    return v, v_pass


@kernel
def _heed_branching(
    n: Traffic, d: Demand, b: int, slot: int, lane: int, place: int, seen: float, v: float, v_pass: float
) -> tuple[float, float]:
    """Return speeds behind vehicles on a lane that branches off, as far as it is beside this one [m/s].

    `place` is the row of the other lane in `Traffic.sibling`; see `_heed_leaders`.
    """
    room, is_there = n.occupancy, n.links.total[slot] == 0
    entry = room.head[n.sibling[place]]
    while entry >= 0:
        is_ahead = not is_there or room.front[entry] > n.driven.front[b, slot]
        if room.slot[entry] != slot and is_ahead and room.back[entry] < n.sibling_until[place]:
            v, v_pass = _heed_leader(n, d, b, slot, lane, entry, seen, v, v_pass)
        entry = room.next[entry]
    return v, v_pass


@kernel
def _heed_leader(
    n: Traffic, d: Demand, b: int, slot: int, lane: int, entry: int, seen: float, v: float, v_pass: float
) -> tuple[float, float]:
    """Return speeds behind one vehicle [m/s], see `_heed_leaders`."""
    types, t, room, links = d.types, n.driven.type[b, slot], n.occupancy, n.links
    speed, last = max(n.state.vehicles.speed[b, slot], 0.0), links.total[slot] - 1
    other, pace = room.slot[entry], room.pace[entry]
    gap = seen - n.lane_length[lane] + room.back[entry] - types.min_gap[t]
    decel = decel_of(n, d, b, other)
    if gap < 0.0 and last >= 0 and room.back[entry] < 0.0 and not _is_tail_on_way(n, d, b, slot, other, lane):
        # Its tail is on another lane that joins here.
        before = seen - n.lane_length[lane] - CLOSE
        inside = d.ways.lane[n.driven.row[b, slot] if last == 0 else links.row[slot, last - 1]]
        if n.roads.lane_inside[inside]:
            before -= n.lane_length[inside]
        safe = stop_speed(n, d, b, slot, speed, before, types.decel[t])
    else:
        safe = follow_speed(n, d, b, slot, speed, gap, pace, decel)
    if last >= 0:
        _leave_at_most(n, slot, last, follow_speed(n, d, b, slot, links.speed[slot, last], gap, pace, decel))
    return min(v, safe), min(v_pass, safe)


@kernel
def _is_tail_on_way(n: Traffic, d: Demand, b: int, slot: int, other: int, lane: int) -> bool:
    """Return whether a vehicle's tail is on the lane before this one on the driver's way."""
    if n.state.vehicles.owner[b, other] != n.owner:
        return True
    last = n.links.total[slot] - 1
    before = d.ways.lane[n.driven.row[b, slot] if last == 0 else n.links.row[slot, last - 1]]
    if n.driven.tails[b, other, 0] == before or d.ways.lane[n.driven.row[b, other]] == before:
        return True
    return n.driven.tails[b, other, 1] == before


@kernel
def _finish_change(n: Traffic, d: Demand, b: int, slot: int, row: int, seen: float, v: float) -> float:
    """Return a speed with which a lane change is over before a turn, or before the other lane ends [m/s]."""
    side = n.driven.side[b, slot]
    if side == 0:
        return v
    following = d.ways.next[row]
    target = d.ways.lane[following]
    own = d.ways.lane[n.driven.row[b, slot]]
    other = lane_beside(n, b, slot, own)
    beside = (
        d.ways.left[following] if other >= 0 and other == n.roads.lane_left[own] else d.ways.right[following]
    )
    if not n.lane_turns[target] and beside >= 0:
        return v
    left = max((1.0 - n.driven.done[b, slot]) * DURATION, n.state.dt)
    speed = max(n.state.vehicles.speed[b, slot], 0.0)
    decel = d.types.decel[n.driven.type[b, slot]]
    return min(v, max(stop_speed(n, d, b, slot, speed, seen - CLOSE, decel), (seen - CLOSE) / left))


@kernel
def _add_link(
    n: Traffic,
    d: Demand,
    b: int,
    slot: int,
    row: int,
    seen: float,
    v: float,
    v_pass: float,
    lane_most: float,
    slowed: bool,
) -> tuple[bool, bool]:
    """Write the link at a lane's end; return whether one is slowed down for, and whether this one stops.

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        row: Row of the lane.
        seen: Distance to its end [m].
        v: Highest speed after the step so far [m/s].
        v_pass: Highest speed at the lane's end [m/s].
        lane_most: Desired speed on the lane [m/s].
        slowed: Whether the vehicle slows down for a link before.
    """
    types, links, t, dt = d.types, n.links, n.driven.type[b, slot], n.state.dt
    lane, target = d.ways.lane[row], d.ways.lane[d.ways.next[row]]
    link = links.total[slot]
    speed, ballistic = max(n.state.vehicles.speed[b, slot], 0.0), n.ballistic[b]
    light, first = light_of(n, target), is_first(n, target)
    holds = light in (_RED, _AMBER)
    decel = max(min(LIGHT_DECEL, types.hardest[t]), types.decel[t]) if holds else types.decel[t]
    braking = brake_gap(speed, decel, 0.0, dt, ballistic)
    can_brake = seen >= braking
    gap = LINE_GAP if holds or first else 0.0
    gap = max(CLOSE, min(gap, seen - braking) if can_brake else gap)
    leaves = n.roads.lane_inside[d.ways.lane[n.driven.row[b, slot]]] and link == 0
    asks = (v > LEAST_REQUEST and not (slowed and not n.roads.lane_inside[lane])) or leaves
    waiting = min(v, stop_speed(n, d, b, slot, speed, max(0.0, seen - gap), decel))
    links.total[slot] = link + 1
    links.row[slot, link], links.distance[slot, link] = d.ways.next[row], seen
    links.leaving_speed[slot, link] = np.inf
    if holds and can_brake and not ignores_light(n, d, b, slot, target, can_brake):
        links.speed[slot, link], links.waiting[slot, link], links.asks[slot, link] = v, waiting, False
        return slowed, True
    if n.roads.lane_inside[lane]:
        v, v_pass, waiting, asks = heed_conflicts(n, d, b, slot, row, seen, v, v_pass, waiting, asks)
    _leave_at_most(n, slot, link - 1, lane_most)
    arriving = v_pass
    if not first and seen > max(braking, VISIBLE):
        safe = safe_stop_speed(VISIBLE, speed, types.decel[t], dt if ballistic else 0.0, dt, ballistic)
        arriving = min(v_pass, speed_after(VISIBLE, safe, types.accel[t], types.max_speed[t]))
        slowed = True
    _time_link(n, d, b, slot, link, target, v, arriving)
    links.speed[slot, link], links.waiting[slot, link], links.asks[slot, link] = v, waiting, asks
    return slowed, False


@kernel
def _time_link(
    n: Traffic, d: Demand, b: int, slot: int, link: int, target: int, v: float, arriving: float
) -> None:
    """Write when and how fast a vehicle comes to a link, also if it brakes, and leaves the lane behind."""
    types, links, t = d.types, n.links, n.driven.type[b, slot]
    seen, ballistic, decel, tau = links.distance[slot, link], n.ballistic[b], types.decel[t], types.tau[t]
    speed = max(n.state.vehicles.speed[b, slot], 0.0) if ballistic else max(v, 0.0)
    arriving = max(arriving, 0.0)
    links.arrival[slot, link] = soonest_arrival(seen, speed, arriving, types.accel[t], decel)
    links.arrival_speed[slot, link] = arriving
    braked = 0.0
    if seen < braking_distance(n, d, b, slot, v, tau):
        left = seen - speed * tau
        braked = speed_after(left, speed, -decel, types.max_speed[t])
        if not ballistic:
            if seen < speed:
                braked = np.inf
            elif speed * speed < 2.0 * left * decel:
                braked = decel
            braked = min(braked, arriving)
    links.braking_speed[slot, link] = braked
    leaving = speed_after(n.lane_length[target], arriving, types.accel[t], types.max_speed[t])
    links.leaving_speed[slot, link] = min(desired_speed(n, d, b, slot, target), leaving)


@kernel
def register(n: Traffic, d: Demand, b: int, slot: int) -> None:
    """Announce a vehicle at the links that it asks to pass."""
    links = n.links
    for link in range(links.total[slot]):
        if links.row[slot, link] >= 0:
            lane = d.ways.lane[links.row[slot, link]]
            _announce(n, b, slot, link, lane)


@kernel
def _announce(n: Traffic, b: int, slot: int, link: int, lane: int) -> None:
    links = n.links
    mean = 0.5 * (links.arrival_speed[slot, link] + links.leaving_speed[slot, link])
    passing = n.lane_length[lane] + n.state.vehicles.length[b, slot]
    links.leaving[slot, link] = links.arrival[slot, link] + passing / max(mean, SLACK)
    if links.asks[slot, link]:
        links.next[slot, link] = n.occupancy.approach[lane]
        n.occupancy.approach[lane] = slot * LINKS + link


@kernel
def register_other(n: Traffic, b: int, slot: int) -> None:
    """Announce a vehicle of another provider at the links that it may come to."""
    links, lane = n.links, n.occupancy.other_lane[slot]
    links.total[slot] = 0
    if lane < 0 or n.roads.lane_inside[lane]:
        return
    seen = max(n.lane_length[lane] - n.occupancy.other_front[slot], 0.0)
    if seen > AGENTS_AHEAD or n.occupancy.other_front[slot] > n.lane_length[lane]:
        return
    speed = max(n.state.vehicles.speed[b, slot], 0.0)
    for place in range(n.successor_start[lane], n.successor_start[lane + 1]):
        target, link = n.successor[place], links.total[slot]
        light = light_of(n, target)
        if link == LINKS or not n.roads.lane_inside[target] or not may_take(n, b, slot, target):
            continue
        if light in (_RED, _AMBER) and seen > 0.5 * speed * speed / DECEL:
            continue
        limit = n.roads.lane_speed[target]
        arriving = speed_after(seen, speed, ACCEL, max(limit, speed))
        links.distance[slot, link], links.asks[slot, link] = seen, speed > CLOSE
        links.arrival[slot, link] = soonest_arrival(seen, speed, arriving, ACCEL, DECEL)
        links.arrival_speed[slot, link] = arriving
        left = seen - speed
        braked = 0.0 if 0.5 * speed * speed / DECEL <= left else speed_after(left, speed, -DECEL, speed)
        links.braking_speed[slot, link] = braked
        links.leaving_speed[slot, link] = speed_after(
            n.lane_length[target], arriving, ACCEL, max(limit, arriving)
        )
        links.total[slot] = link + 1
        _announce(n, b, slot, link, target)


@kernel
def clear_requests(n: Traffic) -> None:
    """Forget all requests."""
    for slot in range(n.links.total.shape[0]):
        n.links.total[slot] = 0
    n.occupancy.approach[:] = -1


@kernel
def check_room(n: Traffic, d: Demand, b: int, slot: int, ahead: float) -> None:
    """Withdraw requests for junctions behind which a vehicle would have no room (`checkRewindLinkLanes`).

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        ahead: Lengths and least gaps of the vehicles before it on its lane [m].
    """
    links, ways, count = n.links, d.ways, n.links.total[slot]
    space, stands = -ahead, False
    for link in range(count):
        links.blocked[slot, link] = False
        row = links.row[slot, link]
        if row < 0 or stands:
            links.room[slot, link] = space
            continue
        lane = ways.lane[row]
        if n.roads.lane_inside[lane]:
            space -= n.occupancy.taken[lane]
        else:
            free, found, waits = _space_on(n, d, b, slot, lane)
            space += free
            stands = found or waits
            links.blocked[slot, link] = stands
        links.room[slot, link] = space
    # What is behind a junction counts before it, too, if the vehicle can drive through.
    for link in range(count - 1, 0, -1):
        lane = ways.lane[links.row[slot, link - 1]]
        leaves = not n.roads.lane_inside[lane] or links.row[slot, link] < 0 or links.asks[slot, link]
        is_open = leaves and (link == 1 or is_first(n, lane))
        stands = stands or not is_open
        # A vehicle may wait inside the junction where it has a place to.
        waits_there = link > 1 and is_waiting_lane(n, ways.lane[links.row[slot, link - 2]])
        continues = is_open or is_waiting_lane(n, lane) or waits_there
        if continues and not links.blocked[slot, link - 1]:
            links.room[slot, link - 1] = links.room[slot, link]
    if not stands:
        return
    own_inside = n.roads.lane_inside[ways.lane[n.driven.row[b, slot]]]
    needed = n.state.vehicles.length[b, slot] + d.types.min_gap[n.driven.type[b, slot]]
    for link in range(count):
        row = links.row[slot, link]
        if row < 0 or links.room[slot, link] >= needed or not _keeps_clear(n, ways.lane[row]):
            continue
        if link == 0 and own_inside:
            return
        _withdraw(n, d, b, slot, link)
        return


@kernel
def _withdraw(n: Traffic, d: Demand, b: int, slot: int, link: int) -> None:
    """Withdraw a request and those behind it, if the vehicle can stop before it."""
    links, speed = n.links, max(n.state.vehicles.speed[b, slot], 0.0)
    braking = braking_distance(n, d, b, slot, speed, 0.0)
    for later in range(link, links.total[slot]):
        if links.row[slot, later] < 0:
            return
        if links.distance[slot, later] >= braking:
            links.asks[slot, later] = False


@kernel
def _keeps_clear(n: Traffic, lane: int) -> bool:
    """Return whether a lane crosses others, so that no vehicle may stop on it."""
    return n.roads.conflict_start[lane + 1] > n.roads.conflict_start[lane]


@kernel
def _space_on(n: Traffic, d: Demand, b: int, slot: int, lane: int) -> tuple[float, bool, bool]:
    """Return the space to the last vehicle that stands on a lane [m], if one does, if it waits."""
    room, lengths = n.occupancy, 0.0
    entry = rearmost(n, lane, slot)
    waits = entry >= 0 and bool(n.driven.must_wait[b, room.slot[entry]])
    while entry >= 0:
        if room.slot[entry] != slot:
            if room.pace[entry] < 0.1:
                return float(room.back[entry] - lengths), True, waits
            lengths += room.front[entry] - room.back[entry] + LEAST_GAP
        entry = room.next[entry]
    return n.lane_length[lane] - lengths, False, waits
