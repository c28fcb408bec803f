"""Kernels that plan a vehicle's step: speeds for each link ahead, requests (SUMO's `planMoveInternal`)."""

from __future__ import annotations

import numpy as np

from smarts.dynamics import car_following as cf
from smarts.geometry.compiling import kernel
from smarts.providers.native.driving import desired_speed, follow, stop
from smarts.providers.native.junctions import heed_conflicts, ignores_light, is_first, light_of
from smarts.providers.native.occupancy import LEAST_GAP, entry_ahead, lane_beside, may_take
from smarts.providers.native.state import LINKS, Car, Entry, Lane, Link, Record, Traffic
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
def plan(n: Traffic, car: Car) -> None:
    """Write a vehicle's links ahead; the last one is where it stops, arrives, or does not look farther.

    `Link.speed` and `Link.arrival_speed` are the highest speeds so far, after the step and at the lane's end.
    """
    kind, lane, link = n.types[car.type], n.lanes[car.lane], n.links[car.slot, 0]
    most, comfortable = cf.highest_next(kind, car.speed), cf.lowest_next(kind, car.speed)
    lane_most = max(car.desired, comfortable)
    reach = n.dt * most + cf.brake_gap(kind, most, kind.decel, kind.tau)
    link.row, link.distance, link.speed = car.row, lane.length - car.front, min(most, lane_most)
    onward = link.distance
    outside, inside = 0.0, onward if lane.inside else 0.0
    slowed, was_outside = False, False
    car.links = 0
    while True:
        way = n.ways[link.row]
        link.target, link.leaving_speed = way.next, np.inf
        link.arrival_speed = min(cf.speed_after(onward, link.speed, kind.accel, kind.max_speed), lane_most)
        _heed_leaders(n, car, link)
        if car.links > 0:
            before = n.links[car.slot, car.links - 1]
            before.waiting = min(before.waiting, link.speed)
        if way.stop < np.inf or link.target < 0 or car.links == LINKS - 1:
            _end_links(n, car, link, lane_most)
            return
        _finish_change(n, car, link)
        slowed, stops = _add_link(n, car, link, lane_most, slowed)
        if stops:
            return
        lane = n.lanes[n.ways[link.target].lane]
        was_outside = was_outside or not lane.inside
        has_room = outside > max(ROOM_AHEAD * car.length, car.length + inside)
        if (not link.asks or link.speed <= 0.0 or link.distance > reach) and was_outside and has_room:
            return
        lane_most, onward = desired_speed(n, car, lane), lane.length
        v = min(link.speed, max(cf.slow_to(kind, car.speed, lane_most, link.distance), comfortable))
        inside, outside = (inside + onward, outside) if lane.inside else (inside, outside + onward)
        after = n.links[car.slot, car.links]
        after.row, after.distance, after.speed = link.target, link.distance + onward, v
        link = after


@kernel
def _end_links(n: Traffic, car: Car, link: Link, lane_most: float) -> None:
    """Write the last link: not to be passed."""
    kind, way, end = n.types[car.type], n.ways[link.row], link.speed
    begin = link.distance - n.lanes[way.lane].length
    if way.stop < np.inf:
        end = stop(n, car, begin + way.stop)
    elif way.arrival < np.inf:
        left = link.distance + way.arrival - n.lanes[way.lane].length - n.dt * lane_most
        end = max(cf.SLACK, cf.slow_to(kind, car.speed, lane_most, left))
    elif link.target < 0:
        end = stop(n, car, link.distance)
    _leave_at_most(n, car, end)
    link.target, link.asks = -1, False
    link.speed = link.waiting = min(link.speed, end)
    car.links += 1


@kernel
def _leave_at_most(n: Traffic, car: Car, speed: float) -> None:
    """Bound the speed with which a vehicle leaves the lane behind the link before the one that it plans."""
    if car.links > 0:
        before = n.links[car.slot, car.links - 1]
        before.leaving_speed = min(before.leaving_speed, speed)


@kernel
def _heed_leaders(n: Traffic, car: Car, link: Link) -> None:
    """Slow down for the vehicles ahead on a lane, and on the one beside during a lane change."""
    way, is_own = n.ways[link.row], car.links == 0
    lane = n.lanes[way.lane]
    ahead = entry_ahead(n, way.lane, car.front if is_own else -np.inf, car)
    if ahead >= 0:
        _heed_leader(n, car, link, lane, n.entries[ahead], link.distance)
    for place in range(lane.siblings, n.lanes[way.lane + 1].siblings):
        _heed_branching(n, car, link, lane, n.siblings[place])
    if car.side == 0:
        return
    other = lane_beside(n, car)
    if other >= 0 and not is_own:
        beside = way.left if other == n.lanes[car.lane].left else way.right
        other = n.ways[beside].lane if beside >= 0 else -1
    if other >= 0:
        there, seen = car.front * n.lanes[other].length / lane.length, link.distance
        if is_own:
            seen = n.lanes[other].length - there
        ahead = entry_ahead(n, other, there if is_own else -np.inf, car)
        if ahead >= 0:
            _heed_leader(n, car, link, n.lanes[other], n.entries[ahead], seen)


@kernel
def _heed_branching(n: Traffic, car: Car, link: Link, lane: Lane, sibling: Record) -> None:
    """Slow down for vehicles on a lane that branches off, as far as it is beside this one."""
    found = n.lanes[sibling.lane].head
    while found >= 0:
        entry = n.entries[found]
        is_ahead = car.links > 0 or entry.front > car.front
        if entry.car != car.place and is_ahead and entry.back < sibling.until:
            _heed_leader(n, car, link, lane, entry, link.distance)
        found = entry.next


@kernel
def _heed_leader(n: Traffic, car: Car, link: Link, lane: Lane, entry: Entry, seen: float) -> None:
    """Slow down for one vehicle on a lane that ends in a distance."""
    foe, last = n.cars[entry.car], car.links - 1
    gap = seen - lane.length + entry.back - n.types[car.type].min_gap
    if gap < 0.0 and last >= 0 and entry.back < 0.0 and not _is_tail_on_way(n, car, foe):
        # Its tail is on another lane that joins here.
        before, inside = seen - lane.length - CLOSE, n.lanes[n.ways[n.links[car.slot, last].row].lane]
        safe = stop(n, car, before - inside.length if inside.inside else before)
    else:
        safe = follow(n, car, gap, car.speed, foe, entry.speed)
    if last >= 0:
        _leave_at_most(n, car, follow(n, car, gap, n.links[car.slot, last].leaving_speed, foe, entry.speed))
    link.speed, link.arrival_speed = min(link.speed, safe), min(link.arrival_speed, safe)


@kernel
def _is_tail_on_way(n: Traffic, car: Car, foe: Car) -> bool:
    """Return whether a vehicle's tail is on the lane before this one on the driver's way."""
    before = n.ways[n.links[car.slot, car.links - 1].row].lane
    return not foe.is_own or foe.tails[0] == before or foe.lane == before or foe.tails[1] == before


@kernel
def _finish_change(n: Traffic, car: Car, link: Link) -> None:
    """Let a lane change be over before a turn, or before the other lane ends."""
    if car.side == 0:
        return
    following, other = n.ways[link.target], lane_beside(n, car)
    beside = following.left if other >= 0 and other == n.lanes[car.lane].left else following.right
    if n.lanes[following.lane].turns or beside < 0:
        left, gap = max((1.0 - car.done) * DURATION, n.dt), link.distance - CLOSE
        link.speed = min(link.speed, max(stop(n, car, gap), gap / left))


@kernel
def _add_link(n: Traffic, car: Car, link: Link, lane_most: float, slowed: bool) -> tuple[bool, bool]:
    """Write the link at a lane's end; return whether one is slowed down for, and whether this one stops.

    Args:
        n: Native traffic.
        car: The vehicle.
        link: Its row, distance and speeds so far.
        lane_most: Desired speed on the lane [m/s].
        slowed: Whether the vehicle slows down for a link before.
    """
    kind, inside = n.types[car.type], n.lanes[n.ways[link.row].lane].inside
    target = n.lanes[n.ways[link.target].lane]
    first, holds = is_first(target), light_of(target) in (_RED, _AMBER)
    decel = max(min(LIGHT_DECEL, kind.hardest), kind.decel) if holds else kind.decel
    braking = cf.brake_gap(kind, car.speed, decel, 0.0)
    can_brake = link.distance >= braking
    gap = LINE_GAP if holds or first else 0.0
    gap = max(CLOSE, min(gap, link.distance - braking) if can_brake else gap)
    leaves = n.lanes[car.lane].inside and car.links == 0
    link.asks = (link.speed > LEAST_REQUEST and not (slowed and not inside)) or leaves
    waiting = cf.stop_speed(kind, max(0.0, link.distance - gap), car.speed, decel, car.desired)
    link.waiting = min(link.speed, waiting)
    if holds and can_brake and not ignores_light(n, car, target, can_brake):
        link.asks = False
        car.links += 1
        return slowed, True
    if inside:
        heed_conflicts(n, car, link)
    _leave_at_most(n, car, lane_most)
    if not first and link.distance > max(braking, VISIBLE):
        safe = cf.safe_stop_speed(kind, VISIBLE, car.speed, kind.decel, n.dt if kind.ballistic else 0.0)
        link.arrival_speed = min(
            link.arrival_speed, cf.speed_after(VISIBLE, safe, kind.accel, kind.max_speed)
        )
        slowed = True
    _time_link(n, car, link, target)
    car.links += 1
    return slowed, False


@kernel
def _time_link(n: Traffic, car: Car, link: Link, target: Lane) -> None:
    """Write when and how fast a vehicle comes to a link, also if it brakes, and leaves the lane behind."""
    kind = n.types[car.type]
    speed = car.speed if kind.ballistic else max(link.speed, 0.0)
    link.arrival_speed = max(link.arrival_speed, 0.0)
    link.arrival = cf.soonest_arrival(kind, link.distance, speed, link.arrival_speed)
    link.braking_speed = 0.0
    if link.distance < cf.brake_gap(kind, link.speed, kind.decel, kind.tau):
        left = link.distance - speed * kind.tau
        braked = cf.speed_after(left, speed, -kind.decel, kind.max_speed)
        if not kind.ballistic:
            if link.distance < speed:
                braked = np.inf
            elif speed * speed < 2.0 * left * kind.decel:
                braked = kind.decel
            braked = min(braked, link.arrival_speed)
        link.braking_speed = braked
    leaving = cf.speed_after(target.length, link.arrival_speed, kind.accel, kind.max_speed)
    link.leaving_speed = min(desired_speed(n, car, target), leaving)


@kernel
def register(n: Traffic, car: Car) -> None:
    """Announce a vehicle at the links that it asks to pass."""
    for number in range(car.links):
        link = n.links[car.slot, number]
        if link.target >= 0 and link.asks:
            _announce(n, car, number, n.ways[link.target].lane)


@kernel
def _announce(n: Traffic, car: Car, number: int, target: int) -> None:
    """Announce a vehicle at the link to a lane."""
    link, lane = n.links[car.slot, number], n.lanes[target]
    mean = 0.5 * (link.arrival_speed + link.leaving_speed)
    link.leaving = link.arrival + (lane.length + car.length) / max(mean, cf.SLACK)
    link.next, lane.approach = lane.approach, car.slot * LINKS + number


@kernel
def register_other(n: Traffic, car: Car) -> None:
    """Announce a vehicle of another provider at the links that it may come to."""
    kind, lane = n.types[car.type], n.lanes[car.lane]
    seen = max(lane.length - car.front, 0.0)
    if car.lane < 0 or lane.inside or seen > AGENTS_AHEAD or car.front > lane.length:
        return
    can_brake = seen > 0.5 * car.speed * car.speed / kind.decel
    for place in range(lane.successors, n.lanes[car.lane + 1].successors):
        number = n.successor[place]
        target = n.lanes[number]
        if car.links == LINKS or not target.inside or not may_take(n, car, number):
            continue
        if light_of(target) in (_RED, _AMBER) and can_brake:
            continue
        link = n.links[car.slot, car.links]
        link.distance, link.speed, link.asks = seen, car.speed, car.speed > CLOSE
        link.arrival_speed = cf.speed_after(seen, car.speed, kind.accel, max(target.speed, car.speed))
        _time_link(n, car, link, target)
        if link.asks:
            _announce(n, car, car.links, number)
        car.links += 1


@kernel
def withdraw_all(n: Traffic, car: Car) -> None:
    """Forget the requests of a vehicle."""
    if car.is_own:
        for number in range(car.links):
            link = n.links[car.slot, number]
            if link.target >= 0:
                n.lanes[n.ways[link.target].lane].approach = -1
    elif car.links > 0:
        for place in range(n.lanes[car.lane].successors, n.lanes[car.lane + 1].successors):
            n.lanes[n.successor[place]].approach = -1


@kernel
def check_room(n: Traffic, car: Car) -> None:
    """Withdraw requests for junctions behind which a vehicle would have no room (`checkRewindLinkLanes`)."""
    space, stands = -lengths_ahead(n, car, car.lane), False
    for number in range(car.links):
        link = n.links[car.slot, number]
        link.blocked = False
        if link.target >= 0 and not stands:
            target = n.ways[link.target].lane
            if n.lanes[target].inside:
                space -= n.lanes[target].taken
            else:
                free, found, waits = _space_on(n, car, target)
                space += free
                stands = link.blocked = found or waits
        link.room = space
    # What is behind a junction counts before it, too, if the vehicle can drive through.
    for number in range(car.links - 1, 0, -1):
        link, before = n.links[car.slot, number], n.links[car.slot, number - 1]
        lane = n.lanes[n.ways[link.row].lane]
        leaves = not lane.inside or link.target < 0 or link.asks
        is_free = leaves and (number == 1 or is_first(lane))
        stands = stands or not is_free
        # A vehicle may wait inside the junction where it has a place to.
        waits_there = number > 1 and n.lanes[n.ways[before.row].lane].waits
        if (is_free or lane.waits or waits_there) and not before.blocked:
            before.room = link.room
    if not stands:
        return
    needed = car.length + n.types[car.type].min_gap
    for number in range(car.links):
        link = n.links[car.slot, number]
        if link.target < 0 or link.room >= needed or not _keeps_clear(n, n.ways[link.target].lane):
            continue
        if number > 0 or not n.lanes[car.lane].inside:
            _withdraw(n, car, number)
        return


@kernel
def lengths_ahead(n: Traffic, car: Car, number: int) -> float:
    """Return the lengths with gaps of the vehicles ahead of one on its lane, or one beside it [m]."""
    lane, total = n.lanes[number], 0.0
    found = lane.head
    while found >= 0:
        entry = n.entries[found]
        if car.front < entry.front <= lane.length and entry.car != car.place:
            total += entry.front - entry.back + LEAST_GAP
        found = entry.next
    return total


@kernel
def _withdraw(n: Traffic, car: Car, first: int) -> None:
    """Withdraw a request and those behind it, if the vehicle can stop before it."""
    kind = n.types[car.type]
    braking = cf.brake_gap(kind, car.speed, kind.decel, 0.0)
    for number in range(first, car.links):
        link = n.links[car.slot, number]
        if link.target < 0:
            return
        if link.distance >= braking:
            link.asks = False


@kernel
def _keeps_clear(n: Traffic, lane: int) -> bool:
    """Return whether a lane crosses others, so that no vehicle may stop on it."""
    return n.lanes[lane + 1].conflicts > n.lanes[lane].conflicts


@kernel
def _space_on(n: Traffic, car: Car, lane: int) -> tuple[float, bool, bool]:
    """Return the space to the last vehicle that stands on a lane [m], if one does, if it waits."""
    lengths, found = 0.0, entry_ahead(n, lane, -np.inf, car)
    waits = found >= 0 and n.cars[n.entries[found].car].must_wait
    while found >= 0:
        entry = n.entries[found]
        if entry.car != car.place:
            if entry.speed < 0.1:
                return entry.back - lengths, True, waits
            lengths += entry.front - entry.back + LEAST_GAP
        found = entry.next
    return n.lanes[lane].length - lengths, False, waits
