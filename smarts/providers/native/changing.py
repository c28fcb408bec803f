"""Kernels of lane changes: for the route, for others, for speed, to keep right (SUMO's `MSLCM_LC2013`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smarts.dynamics import car_following as cf
from smarts.geometry.compiling import kernel
from smarts.providers.native.driving import desired_speed, follow, stop
from smarts.providers.native.moving import (
    BLOCKS_CHANGE,
    BY_FOLLOWER,
    BY_LEADER,
    COOPERATIVE,
    STRATEGIC,
    decides,
    move_across,
)
from smarts.providers.native.occupancy import add_entry, entry_ahead, entry_behind
from smarts.providers.native.planning import DURATION, lengths_ahead
from smarts.providers.native.state import ADVICES, Car, Traffic
from smarts.providers.native.ways import FARTHEST

LOOK_AHEAD = 10.0
"""How far ahead of a lane's end drivers want to be on the right lane [s]; twice that to the left."""
FORGETS = 0.1
"""Share of the speed that they look ahead for that is forgotten [1/s]."""
TURN_LANE = 200.0
"""Drivers do not leave their lane for one that leads elsewhere within this distance [m]."""
LEAST_NORM, SLOWER = 10.0, 5.0 / 3.6
"""Speeds by which gains are divided, at least, and by which the right lane may be slower [m/s]."""
THRESHOLD, RIGHT_THRESHOLD = 0.2, 2.0
"""Accumulated gains from which on drivers change to the left, and to the right or to keep right."""
KEEP_RIGHT_TIME, RIGHT_TIME, REMAINS = 5.0, 7.0, 20.0
"""Times to keep right, of a free right lane, and that a faster lane has to last [s]."""
HELP, FALL_BACK = 10.0 / 3.6, 7.0 / 3.6
"""Speed at which one that wants in overtakes [m/s]; least deceleration to fall back [m/s^2]."""
URGENCY, LONG_LANE, FAST = 2.0, 200.0, 27.0
"""Share of the time that is left in which a gap has to open; on longer lanes [m], and for faster drivers
[m/s], those behind are asked to slow down."""
RESERVED_RIGHT, RESERVED_LEFT = 20.0, 40.0
"""Room kept for vehicles that may want the other way, where several lanes have to be changed [m]."""
MORE, BEHIND = 20.0, 60.0
"""How far beyond their braking distance drivers look ahead on other lanes, and how far behind [m]."""
HIGHWAY = 80.0 / 3.6
"""On faster roads drivers that are on the best lane stay on it [m/s]."""


class Near(NamedTuple):
    """A vehicle near by."""

    entry: int
    """-1 for none."""
    gap: float
    """Less the follower's least one."""


class Change(NamedTuple):
    """A lane change that a driver considers."""

    side: int
    """1 for the left, -1 for the right."""
    row: int
    """Row of the lane beside."""
    there: float
    """Place of the front on it."""
    leader: Near
    ahead: Near
    """The vehicles ahead, and behind, on the lane beside."""
    behind: Near
    blocked: int
    """`BY_LEADER` and `BY_FOLLOWER`."""


@kernel
def change_lanes(n: Traffic, b: int) -> None:
    """Let vehicles begin lane changes, from the foremost on."""
    order, count = n.order, 0
    for slot in range(n.used[b]):
        if n.driven[b, slot] < 0:
            continue
        car = n.by_slot[b, slot]
        lane, way = n.lanes[car.lane], n.ways[car.row]
        lane.first_blocked = -1
        has_choice = way.left >= 0 or way.right >= 0
        if car.side != 0 or lane.inside or not has_choice or not decides(n, car):
            continue
        place = count
        while place > 0 and n.by_slot[b, order[place - 1]].front < car.front:
            order[place] = order[place - 1]
            place -= 1
        order[place] = slot
        count += 1
    for place in range(count):
        car = n.by_slot[b, order[place]]
        way = n.ways[car.row]
        changes = way.right >= 0 and _consider(n, car, way.right, -1)
        if not changes and way.left >= 0:
            _consider(n, car, way.left, 1)


@kernel
def _consider(n: Traffic, car: Car, beside: int, side: int) -> bool:
    """Begin a lane change if the driver wants it and has room; return whether it has begun."""
    lane, kind = n.ways[beside].lane, n.types[car.type]
    there = car.front * n.lanes[lane].length / n.lanes[car.lane].length
    reach = cf.brake_gap(kind, car.speed, kind.decel, kind.tau) + MORE
    leader = _find_ahead(n, car, car.row, car.front, reach)
    ahead, behind = _find_ahead(n, car, beside, there, reach), _find_behind(n, car, lane, there)
    if behind.entry >= 0 and ahead.entry >= 0 and _car_of(n, behind) == _car_of(n, ahead):
        behind = Near(-1, np.inf)
    blocked = _blocked_by(n, car, ahead, behind)
    wants, reason = _wants(n, car, Change(side, beside, there, leader, ahead, behind, blocked))
    if not wants:
        if car.wish == side:
            car.wish = 0
        return False
    if blocked == 0 and _has_space(n, car):
        car.side, car.done = side, 0.0
        car.wish = car.reason = car.advised = 0
        car.gain = car.keeping = car.memory = car.reserved = car.space = 0.0
        add_entry(n, lane, car, there, car.length, car.speed)
        move_across(n, car)
        return True
    if reason & STRATEGIC and n.lanes[lane].first_blocked < 0:
        n.lanes[lane].first_blocked = car.place
    if not (car.reason & STRATEGIC and car.wish == -side):
        car.wish, car.reason = side, reason | blocked | (car.reason & BLOCKS_CHANGE)
    return False


@kernel
def _car_of(n: Traffic, near: Near) -> int:
    return n.entries[near.entry].car


@kernel
def _find_ahead(n: Traffic, car: Car, row: int, front: float, reach: float) -> Near:
    """Return the next vehicle ahead on a way."""
    found, seen = entry_ahead(n, n.ways[row].lane, front, car), -front
    while found < 0:
        seen += n.lanes[n.ways[row].lane].length
        row = n.ways[row].next
        if row < 0 or seen > reach:
            return Near(-1, np.inf)
        found = entry_ahead(n, n.ways[row].lane, -np.inf, car)
    return Near(found, seen + n.entries[found].back - n.types[car.type].min_gap)


@kernel
def _find_behind(n: Traffic, car: Car, lane: int, front: float) -> Near:
    """Return the nearest vehicle behind a place on a lane, also on the lanes before."""
    back, found = front - car.length, entry_behind(n, lane, front, car)
    if found >= 0:
        return Near(found, back - n.entries[found].front - _least_gap(n, found))
    nearest = Near(-1, np.inf)
    for place in range(n.lanes[lane].predecessors, n.lanes[lane + 1].predecessors):
        before, far = n.predecessor[place], back
        found = entry_behind(n, before, np.inf, car)
        if found < 0 and n.lanes[before].inside:
            far += n.lanes[before].length
            if n.lanes[before].predecessors < n.lanes[before + 1].predecessors:
                before = n.predecessor[n.lanes[before].predecessors]
                found = entry_behind(n, before, np.inf, car)
        if found >= 0 and n.entries[found].front <= n.lanes[before].length:
            gap = far + n.lanes[before].length - n.entries[found].front - _least_gap(n, found)
            if gap < min(nearest.gap, BEHIND):
                nearest = Near(found, gap)
    return nearest


@kernel
def _least_gap(n: Traffic, entry: int) -> float:
    """Return the gap that the driver of an entry keeps when it stands [m]."""
    return n.types[n.cars[n.entries[entry].car].type].min_gap


@kernel
def _needed_gap(n: Traffic, follower: Car, speed: float, leader: Car, leader_speed: float) -> float:
    """Return the gap that a driver needs behind a leader [m]."""
    kind, its_decel = n.types[follower.type], n.types[leader.type].decel
    found = cf.secure_gap(kind, speed, leader_speed, its_decel)
    if follower.acceleration < -cf.SLACK:
        # A driver that brakes already needs no time to react.
        left = cf.brake_gap(kind, leader_speed, max(kind.decel, its_decel), 0.0)
        found = min(found, max(0.0, cf.brake_gap(kind, speed, -follower.acceleration, 0.0) - left))
    return found


@kernel
def _braking(n: Traffic, car: Car, speed: float, tau: float) -> float:
    """Return the distance in which a driver stops that reacts after `tau` [s] [m]."""
    kind = n.types[car.type]
    return cf.brake_gap(kind, speed, kind.decel, tau)


@kernel
def _blocked_by(n: Traffic, car: Car, ahead: Near, behind: Near) -> int:
    """Return what blocks a lane change: `BY_LEADER` and `BY_FOLLOWER` (`MSLaneChanger::checkChange`)."""
    factor, found = 1.0 / n.types[car.type].assertive, 0
    if behind.entry >= 0:
        entry = n.entries[behind.entry]
        needed = _needed_gap(n, n.cars[entry.car], entry.speed, car, car.speed)
        if behind.gap < max(factor * needed, 0.0):
            found |= BY_FOLLOWER
    if ahead.entry >= 0:
        entry = n.entries[ahead.entry]
        needed = _needed_gap(n, car, car.speed, n.cars[entry.car], entry.speed)
        if ahead.gap < max(factor * needed, 0.0):
            found |= BY_LEADER
    return found


@kernel
def _has_space(n: Traffic, car: Car) -> bool:
    """Return whether a lane change that begins now is over before a turn or the end of the way."""
    decel, row = n.types[car.type].decel, car.row
    mean = 0.5 * (max(0.0, car.speed - decel * n.dt) + max(0.0, car.speed - decel * DURATION))
    needed, seen = mean * DURATION, n.lanes[car.lane].length - car.front
    while seen <= needed:
        row = n.ways[row].next
        if row < 0:
            return seen >= needed
        lane = n.lanes[n.ways[row].lane]
        if lane.turns:
            return False
        seen += lane.length
    return True


@kernel
def _wants(n: Traffic, car: Car, change: Change) -> tuple[bool, int]:
    """Return whether a driver wants to change lanes, and why (`MSLCM_LC2013::_wantsChange`)."""
    kind, way, beside, side = n.types[car.type], n.ways[car.row], n.ways[change.row], change.side
    here, there = min(way.length, FARTHEST), min(beside.length, FARTHEST)
    best = side if way.changes == 0 and beside.changes == 0 else way.changes
    keep = 1.0 - FORGETS * kind.reaction
    car.memory = max(car.speed, keep * car.memory + (1.0 - keep) * car.speed)
    ahead = car.memory * LOOK_AHEAD * kind.strategic * (2.0 if side > 0 else 1.0)
    ahead += 2.0 * (car.length + kind.min_gap)
    to_best = best * side > 0
    is_due = to_best and best == way.changes
    if is_due and here - car.front - _taken_on(n, car, car.row, best) < ahead * abs(best):
        _prepare(n, car, change, best, here - car.front)
        return True, STRATEGIC
    left = max(0.0, there - car.front - max(_taken_on(n, car, car.row, 0), _taken_on(n, car, change.row, 0)))
    if not to_best and left < ahead * (abs(best) + 2):
        return False, 0
    if best == 0 and (2.0 * left < ahead or (there < TURN_LANE and _leads_on(n, change.row))):
        return False, 0
    rising = _speeds_up(n, change.leader) or _speeds_up(n, change.ahead)
    on_own = _expected_speed(n, car, change.leader, here, car.desired, rising)
    its_desired = desired_speed(n, car, n.lanes[beside.lane])
    on_other = _expected_speed(n, car, change.ahead, there, its_desired, rising)
    loss = car.gain / _threshold(n, car, side) if side < 0 else -car.gain / _threshold(n, car, side)
    loss = min(1.0, max(loss, on_own / max(on_other, 1e-9) - 1.0))
    if side < 0 and best == 0 and n.lanes[car.lane].speed > HIGHWAY:
        return False, 0
    helps = car.asked == side and loss <= kind.cooperative
    if helps and (to_best or there >= ahead * (abs(best) + 1)):
        return True, COOPERATIVE
    if _wants_speed(n, car, change, there, on_own, on_other):
        return True, 0
    # Towards the lane of the route, where it does not cost speed.
    gains = on_other >= on_own and car.gain * side > 0.0
    return to_best and best == way.changes and gains, STRATEGIC


@kernel
def _taken_on(n: Traffic, car: Car, row: int, changes: int) -> float:
    """Return how much vehicles ahead take up of a lane some changes away, and of the next two [m]."""
    while changes != 0:
        beside = n.ways[row].left if changes > 0 else n.ways[row].right
        changes -= 1 if changes > 0 else -1
        row = beside if beside >= 0 else row
    taken = lengths_ahead(n, car, n.ways[row].lane)
    for _ in range(2):
        row = n.ways[row].next
        if row < 0:
            break
        taken += n.lanes[n.ways[row].lane].taken
    return taken


@kernel
def _leads_on(n: Traffic, row: int) -> bool:
    """Return whether the last lane that is reached without a change leads anywhere, if not on the route."""
    while n.ways[row].next >= 0:
        row = n.ways[row].next
    lane = n.ways[row].lane
    return n.lanes[lane].successors < n.lanes[lane + 1].successors


@kernel
def _speeds_up(n: Traffic, near: Near) -> bool:
    return near.entry >= 0 and n.cars[_car_of(n, near)].acceleration > 0.0


@kernel
def _threshold(n: Traffic, car: Car, side: int) -> float:
    """Return the gain from which on a driver changes to a side."""
    gain = max(n.types[car.type].speed_gain, 1e-9)
    return THRESHOLD / gain if side > 0 else RIGHT_THRESHOLD / gain


@kernel
def _wants_speed(n: Traffic, car: Car, change: Change, there: float, on_own: float, on_other: float) -> bool:
    """Return whether a driver wants to a side for speed, or since the right is free; remember its gain.

    Args:
        n: Native traffic.
        car: The vehicle.
        change: The lane change.
        there: How far the lane beside leads [m].
        on_own: Speed that it expects on its lane [m/s].
        on_other: Speed on the lane beside [m/s].
    """
    kind, threshold = n.types[car.type], _threshold(n, car, change.side)
    gains, lasts = (on_other - on_own) / max(on_other, LEAST_NORM), there > REMAINS * max(0.1, car.speed)
    if change.side > 0:
        if gains > 0.0:
            car.gain += kind.reaction * gains
        elif car.gain > 0.0:
            car.gain *= (0.8 if on_own == on_other else 0.5) ** kind.reaction
        return lasts and car.gain > threshold and gains > cf.SLACK
    if on_own - SLOWER > on_other:
        if car.gain < 0.0:
            car.gain *= 0.5**kind.reaction
    else:
        if car.gain < 0.0 or gains > 0.0:
            car.gain -= kind.reaction * gains
        share = _free_on_right(n, car, there, change.ahead)
        car.keeping -= kind.reaction * threshold * share / KEEP_RIGHT_TIME
        if car.keeping * kind.keep_right < -threshold:
            return True
    return lasts and car.gain < -threshold


@kernel
def _free_on_right(n: Traffic, car: Car, there: float, ahead: Near) -> float:
    """Return how long the lane to the right is free for a driver's speed, as a share of what it wants."""
    most = car.desired
    wanted = RIGHT_TIME * most / n.lanes[car.lane].speed * max(1.0, car.speed)
    free = max(0.0, there - _braking(n, car, most, n.types[car.type].tau))
    seconds = min(wanted, free / most)
    if ahead.entry >= 0 and n.entries[ahead.entry].speed < most:
        entry = n.entries[ahead.entry]
        needed = _needed_gap(n, car, most, n.cars[entry.car], entry.speed)
        free = max(0.0, min(free, ahead.gap - needed))
        seconds = min(seconds, free / (most - entry.speed))
    return seconds / wanted


@kernel
def _expected_speed(n: Traffic, car: Car, near: Near, room: float, most: float, rising: bool) -> float:
    """Return the speed that a driver expects on a lane [m/s] (`anticipateFollowSpeed`).

    Args:
        n: Native traffic.
        car: The vehicle.
        near: The vehicle ahead there.
        room: How far the lane leads [m].
        most: Desired speed there [m/s].
        rising: Whether a leader speeds up.
    """
    kind, soon = n.types[car.type], min(most, car.speed + n.types[car.type].accel * n.dt)
    if near.entry < 0:
        return min(
            most,
            _follow_beside(n, car, room, soon, car, 0.0) if rising else cf.insertion_stop_speed(kind, room),
        )
    entry = n.entries[near.entry]
    leader = n.cars[entry.car]
    if rising:
        return min(most, _follow_beside(n, car, near.gap, soon, leader, entry.speed))
    braking = cf.brake_gap(kind, entry.speed, max(kind.decel, n.types[leader.type].decel), 0.0)
    return min(most, cf.insertion_stop_speed(kind, max(near.gap + braking, 0.0)))


@kernel
def _prepare(n: Traffic, car: Car, change: Change, best: int, space: float) -> None:
    """Prepare a lane change that the route demands: choose a gap, and ask the neighbours for it."""
    car.space = space
    if abs(best) > 1:
        car.reserved = max(car.reserved, RESERVED_RIGHT if change.side < 0 else RESERVED_LEFT)
    if change.ahead.entry >= 0:
        _reserve(n, car, n.cars[_car_of(n, change.ahead)], change.side)
    blocked = n.lanes[car.lane].first_blocked
    if blocked >= 0:
        _reserve(n, car, n.cars[blocked], change.side)
    seconds = max(n.dt, space / max(car.memory, cf.SLACK) / max(1, abs(best)) / URGENCY)
    planned = _ask_leader(n, car, change, seconds)
    if change.behind.entry < 0 or planned <= -1.0:
        return
    entry = n.entries[change.behind.entry]
    foe = n.cars[entry.car]
    if change.blocked & BY_FOLLOWER:
        _ask_follower(n, car, foe, change, seconds, max(planned, 0.0))
    elif change.blocked & BY_LEADER and foe.is_own:
        first = _follow_beside(n, foe, change.behind.gap + n.dt * planned, entry.speed, car, planned)
        room = change.behind.gap + n.dt * (planned - first)
        _advise(n, car, foe, _follow_beside(n, foe, room, entry.speed, car, planned))


@kernel
def _reserve(n: Traffic, car: Car, foe: Car, side: int) -> None:
    """Keep room at the lane's end for a vehicle ahead that wants the other way, or let it keep room."""
    if not foe.is_own or foe.wish != -side:
        return
    needed, own = foe.length + n.types[foe.type].min_gap, car.length + n.types[car.type].min_gap
    its_room = foe.space - _braking(n, foe, foe.speed, n.types[foe.type].reaction)
    if needed > car.space - _braking(n, car, car.speed, 0.0) and (own <= its_room or foe.space > car.space):
        foe.reserved = max(foe.reserved, own)
    else:
        car.reserved = max(car.reserved, needed)


@kernel
def _follow_beside(n: Traffic, car: Car, gap: float, speed: float, leader: Car, leader_speed: float) -> float:
    """Return `follow` beside a vehicle, where a gap below 0 is no emergency (`gComputeLC`)."""
    kind = n.types[car.type]
    if not kind.is_idm:
        gap += cf.brake_gap(kind, leader_speed, max(kind.decel, n.types[leader.type].decel), 0.0)
        leader_speed = 0.0
    return follow(n, car, gap, speed, leader, leader_speed)


@kernel
def _advise(n: Traffic, car: Car, foe: Car, speed: float) -> None:
    """Let a driver ask another for a speed [m/s], which counts by how cooperative that one is, or itself."""
    if foe.is_own and foe.advised < ADVICES:
        weight = 1.0 if foe.place == car.place else n.types[foe.type].cooperative
        foe.advice[foe.advised] = (speed - foe.speed) / n.dt
        foe.weight[foe.advised] = max(0.0, min(1.0, weight))
        foe.advised += 1


@kernel
def _ask_leader(n: Traffic, car: Car, change: Change, seconds: float) -> float:
    """Return the speed of a driver that wants in behind a leader, -1 to pass it [m/s] (`informLeader`)."""
    kind, space, gap = n.types[car.type], car.space - car.reserved, change.ahead.gap
    planned = min(car.speed, stop(n, car, space))
    for place in range(car.advised):
        if car.advice[place] >= -kind.decel:
            planned = min(planned, car.speed + car.advice[place] * n.dt)
    if change.ahead.entry < 0:
        return planned
    pace, foe = n.entries[change.ahead.entry].speed, n.cars[_car_of(n, change.ahead)]
    then = pace - n.dt * max(1.0, -foe.acceleration)
    moved = 0.5 * (pace + then) - 0.5 * (car.speed + planned) if kind.ballistic else then - planned
    target = _follow_beside(n, car, gap + n.dt * moved, car.speed, foe, max(then, 0.0))
    target = max(cf.lowest_next(kind, car.speed), target)
    if not change.blocked & BY_LEADER:
        _advise(n, car, car, target)
        return min(target, planned)
    foe.reason |= BLOCKS_CHANGE
    way = gap + foe.length + n.types[foe.type].min_gap + car.length
    way += _needed_gap(n, foe, pace, car, car.speed)
    faster = planned - pace
    braking = _braking(n, car, car.speed, 0.0 if kind.ballistic else kind.tau)
    if faster > 0.0 and space - braking >= way and seconds >= max(way, 0.0) / faster:
        _advise(n, car, foe, pace)
        return -1.0
    if target >= car.speed:
        _advise(n, car, car, target)
        return planned
    slower = min(kind.decel, max(FALL_BACK, (car.speed - target) / seconds))
    following = min(planned, max(0.0, car.speed - slower * n.dt))
    _advise(n, car, car, following)
    return following


@kernel
def _ask_follower(n: Traffic, car: Car, foe: Car, change: Change, seconds: float, planned: float) -> None:
    """Ask the vehicle behind on the lane beside for a gap, or let it pass (`informFollower`)."""
    if not foe.is_own:
        return
    kind, its, gap, ballistic = n.types[car.type], foe.speed, change.behind.gap, n.types[foe.type].ballistic
    foe.asked = change.side
    lacking = _needed_gap(n, foe, its, car, planned) - gap
    if planned - its >= HELP and lacking / seconds < planned - its:
        _advise(n, car, foe, planned - HELP)
        return
    help_decel = n.types[foe.type].decel
    slower, after = max(0.0, its - help_decel * n.dt), max(0.0, its - help_decel)
    opens = car.speed - its if ballistic else planned - after
    wider = gap + (planned - its + 0.5 * help_decel if ballistic else opens)
    secure = _needed_gap(n, foe, after, car, planned)
    if wider > 0.0 and wider >= secure:
        first = _follow_beside(n, foe, gap + n.dt * planned, its, car, planned)
        room = gap + n.dt * (planned - max(slower, first))
        found = max(slower, _follow_beside(n, foe, room, its, car, planned))
        if ballistic:
            found = min(its, found)
            if room < _needed_gap(n, foe, found, car, planned):
                found = slower
        _advise(n, car, foe, found)
        return
    if opens > 0.0 and opens * (seconds - 1.0 if ballistic else seconds) > secure - wider + 0.1:
        _advise(n, car, foe, slower)
        return
    helped = max(its, car.speed + HELP)
    if its > car.speed and (change.side < 0 or planned > FAST or n.lanes[car.lane].length > LONG_LANE):
        helped = max(slower, car.speed + HELP)
        if (its - car.speed) / help_decel < seconds:
            _advise(n, car, foe, slower if ballistic else helped)
            return
    _advise(n, car, foe, helped)
    way = gap + car.length + kind.min_gap + foe.length
    way += _needed_gap(n, car, planned, foe, helped)
    _advise(n, car, car, max(helped - max(way, 0.0) / seconds, car.speed - kind.decel * n.dt))
