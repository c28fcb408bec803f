"""Kernels of lane changes: for the route, for others, for speed, to keep right (SUMO's `MSLCM_LC2013`)."""

from __future__ import annotations

import numpy as np

from smarts.dynamics.car_following import SLACK, brake_gap, insertion_stop_speed
from smarts.geometry.compiling import kernel
from smarts.providers.native.driving import (
    braking_distance,
    decel_of,
    desired_speed,
    follow_speed,
    least_gap,
    lowest_next,
    needed_gap,
    reaction_of,
    stop_speed,
)
from smarts.providers.native.moving import BLOCKS_CHANGE, BY_FOLLOWER, BY_LEADER, COOPERATIVE, STRATEGIC
from smarts.providers.native.occupancy import add_entry, entry_ahead, entry_behind, rearmost
from smarts.providers.native.planning import DURATION
from smarts.providers.native.state import ADVICES, Demand, Traffic, Types
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
Near = tuple[int, float]
"""Entry of a vehicle near by in `Occupancy`, -1 for none, and the gap less the follower's least one [m]."""


@kernel
def change_lanes(n: Traffic, d: Demand, b: int) -> None:
    """Let vehicles begin lane changes, from the foremost on."""
    driven, dt = n.driven, n.state.dt
    for place in range(driven.listed[b, 0]):
        slot = driven.order[b, place]
        row = driven.row[b, slot]
        lane = d.ways.lane[row]
        reaction = reaction_of(d.types, driven.type[b, slot], dt)
        decides = driven.next_action[b, slot] > (n.tick[b] - 0.5) * dt + reaction - SLACK
        if driven.side[b, slot] != 0 or n.roads.lane_inside[lane] or not decides:
            continue
        for side in (-1, 1):
            beside = d.ways.left[row] if side > 0 else d.ways.right[row]
            if beside >= 0 and _consider(n, d, b, slot, row, beside, side):
                break


@kernel
def _consider(n: Traffic, d: Demand, b: int, slot: int, row: int, beside: int, side: int) -> bool:
    """Begin a lane change if the driver wants it and has room; return whether it has begun."""
    driven, ways = n.driven, d.ways
    there = driven.front[b, slot] * n.lane_length[ways.lane[beside]] / n.lane_length[ways.lane[row]]
    speed = n.state.vehicles.speed[b, slot]
    reach = braking_distance(n, d, b, slot, speed, d.types.tau[driven.type[b, slot]]) + MORE
    leader = find_ahead(n, d, b, slot, row, driven.front[b, slot], reach)
    ahead = find_ahead(n, d, b, slot, beside, there, reach)
    behind = find_behind(n, d, b, slot, ways.lane[beside], there)
    if behind[0] >= 0 and ahead[0] >= 0 and n.occupancy.slot[behind[0]] == n.occupancy.slot[ahead[0]]:
        behind = (-1, np.inf)
    blocked = _blocked_by(n, d, b, slot, ahead, behind)
    wants, reason = _wants(n, d, b, slot, row, beside, side, leader, ahead, behind, blocked)
    if not wants:
        if driven.wish[b, slot] == side:
            driven.wish[b, slot] = 0
        return False
    if blocked == 0 and _has_space(n, d, b, slot, row):
        _begin(n, d, b, slot, beside, side, there)
        return True
    is_urgent = driven.reason[b, slot] & STRATEGIC and driven.wish[b, slot] == -side
    if not is_urgent:
        kept = driven.reason[b, slot] & BLOCKS_CHANGE
        driven.wish[b, slot], driven.reason[b, slot] = side, reason | blocked | kept
    return False


@kernel
def _begin(n: Traffic, d: Demand, b: int, slot: int, beside: int, side: int, there: float) -> None:
    """Begin a lane change; the vehicle is on both lanes from now on."""
    driven = n.driven
    driven.side[b, slot], driven.done[b, slot] = side, 0.0
    driven.wish[b, slot] = driven.reason[b, slot] = driven.advised[b, slot] = 0
    driven.gain[b, slot] = driven.keeping[b, slot] = driven.memory[b, slot] = 0.0
    driven.reserved[b, slot] = driven.space[b, slot] = 0.0
    length = n.state.vehicles.length[b, slot]
    add_entry(n, d.ways.lane[beside], slot, there, there - length, n.state.vehicles.speed[b, slot])


@kernel
def find_ahead(
    n: Traffic, d: Demand, b: int, slot: int, row: int, front: float, reach: float
) -> tuple[int, float]:
    """Return the entry of the next vehicle ahead on a way, -1 for none, and the gap less the least [m]."""
    lane, room = d.ways.lane[row], n.occupancy
    entry, seen = entry_ahead(n, lane, front, slot), -front
    while entry < 0:
        seen += n.lane_length[lane]
        row = d.ways.next[row]
        if row < 0 or seen > reach:
            return -1, np.inf
        lane = d.ways.lane[row]
        entry = rearmost(n, lane, slot)
    return entry, float(seen + room.back[entry] - d.types.min_gap[n.driven.type[b, slot]])


@kernel
def find_behind(n: Traffic, d: Demand, b: int, slot: int, lane: int, front: float) -> tuple[int, float]:
    """Return the entry of the nearest vehicle behind, -1 for none, and the gap less its least [m]."""
    room, best, gap = n.occupancy, -1, np.inf
    back = front - n.state.vehicles.length[b, slot]
    entry = entry_behind(n, lane, front, slot)
    if entry >= 0:
        return entry, back - room.front[entry] - least_gap(n, d, b, room.slot[entry])
    for place in range(n.predecessor_start[lane], n.predecessor_start[lane + 1]):
        before = n.predecessor[place]
        entry, far = entry_behind(n, before, np.inf, slot), back
        if entry < 0 and n.roads.lane_inside[before]:
            far += n.lane_length[before]
            if n.predecessor_start[before] < n.predecessor_start[before + 1]:
                before = n.predecessor[n.predecessor_start[before]]
                entry = entry_behind(n, before, np.inf, slot)
        if entry >= 0 and room.front[entry] <= n.lane_length[before]:
            found = far + n.lane_length[before] - room.front[entry] - least_gap(n, d, b, room.slot[entry])
            if found < min(gap, BEHIND):
                best, gap = entry, found
    return best, gap


@kernel
def _blocked_by(n: Traffic, d: Demand, b: int, slot: int, ahead: Near, behind: Near) -> int:
    """Return what blocks a lane change: `BY_LEADER` and `BY_FOLLOWER` (`MSLaneChanger::checkChange`)."""
    room, v, t, found = n.occupancy, n.state.vehicles, n.driven.type[b, slot], 0
    speed, factor = v.speed[b, slot], 1.0 / d.types.assertive[t]
    decel, dt = d.types.decel[t], n.state.dt
    if behind[0] >= 0:
        other = room.slot[behind[0]]
        left = max(d.types.tau[n.driven.type[b, other]] - dt, 0.0) if v.owner[b, other] == n.owner else 0.9
        then = room.pace[behind[0]] + max(0.0, left * v.acceleration[b, other])
        own = max(0.0, speed + min(0.0, left * v.acceleration[b, slot]))
        if behind[1] < 0.0 or behind[1] < factor * needed_gap(n, d, b, other, then, own, decel):
            found |= BY_FOLLOWER
    if ahead[0] >= 0:
        other = room.slot[ahead[0]]
        left = max(d.types.tau[t] - dt, 0.0)
        then = max(0.0, room.pace[ahead[0]] + min(0.0, left * v.acceleration[b, other]))
        own = speed + max(0.0, left * v.acceleration[b, slot])
        needed = needed_gap(n, d, b, slot, own, then, decel_of(n, d, b, other))
        if ahead[1] < 0.0 or ahead[1] < factor * needed:
            found |= BY_LEADER
    return found


@kernel
def _has_space(n: Traffic, d: Demand, b: int, slot: int, row: int) -> bool:
    """Return whether a lane change that begins now is over before a turn or the end of the way."""
    speed, decel = n.state.vehicles.speed[b, slot], d.types.decel[n.driven.type[b, slot]]
    mean = 0.5 * (max(0.0, speed - decel * n.state.dt) + max(0.0, speed - decel * DURATION))
    needed, seen = mean * DURATION, n.lane_length[d.ways.lane[row]] - n.driven.front[b, slot]
    while seen <= needed:
        row = d.ways.next[row]
        if row < 0:
            return seen >= needed
        lane = d.ways.lane[row]
        if n.lane_turns[lane]:
            return False
        seen += n.lane_length[lane]
    return True


@kernel
def _wants(
    n: Traffic,
    d: Demand,
    b: int,
    slot: int,
    row: int,
    beside: int,
    side: int,
    leader: Near,
    ahead: Near,
    behind: Near,
    blocked: int,
) -> tuple[bool, int]:
    """Return whether a driver wants to change to a side, and why (`MSLCM_LC2013::_wantsChange`).

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        row: Row of its lane.
        beside: Row of the lane beside.
        side: 1 for the left, -1 for the right.
        leader: The vehicle ahead.
        ahead: The one ahead on the lane beside.
        behind: The one behind on the lane beside.
        blocked: What blocks the change.
    """
    driven, ways, types, t, dt = n.driven, d.ways, d.types, n.driven.type[b, slot], n.state.dt
    speed, place, lane = n.state.vehicles.speed[b, slot], driven.front[b, slot], ways.lane[row]
    action = reaction_of(types, t, dt)
    here, there = min(ways.length[row], FARTHEST), min(ways.length[beside], FARTHEST)
    changes = ways.changes[row]
    best = side if changes == 0 and ways.changes[beside] == 0 else changes
    keep = 1.0 - FORGETS * action
    driven.memory[b, slot] = max(speed, keep * driven.memory[b, slot] + (1.0 - keep) * speed)
    room_ahead = driven.memory[b, slot] * LOOK_AHEAD * types.strategic[t] * (2.0 if side > 0 else 1.0)
    room_ahead += 2.0 * (n.state.vehicles.length[b, slot] + types.min_gap[t])
    to_best = best * side > 0
    if to_best and best == changes:
        taken = _taken_on(n, d, row, changes)
        if (here - place - taken) < room_ahead * abs(best):
            _prepare(n, d, b, slot, side, best, here - place, ahead, behind, blocked)
            return True, STRATEGIC
    left = max(0.0, there - place - max(_taken_on(n, d, row, 0), _taken_on(n, d, beside, 0)))
    if not to_best and left < room_ahead * (abs(best) + 2):
        return False, 0
    if best == 0 and (2.0 * left < room_ahead or (there < TURN_LANE and _leads_on(n, d, beside))):
        return False, 0
    most, its_most = (desired_speed(n, d, b, slot, lane), desired_speed(n, d, b, slot, ways.lane[beside]))
    rising = _speeds_up(n, b, leader) or _speeds_up(n, b, ahead)
    on_own = _expected_speed(n, d, b, slot, leader, here, most, rising)
    on_other = _expected_speed(n, d, b, slot, ahead, there, its_most, rising)
    threshold, right_threshold = _thresholds(types, t)
    loss = driven.gain[b, slot] / right_threshold if side < 0 else -driven.gain[b, slot] / threshold
    loss = min(1.0, max(loss, on_own / max(on_other, 1e-9) - 1.0))
    if side < 0 and best == 0 and n.roads.lane_speed[lane] > HIGHWAY:
        return False, 0
    helps = driven.asked[b, slot] == side and loss <= types.cooperative[t]
    if helps and (to_best or there >= room_ahead * (abs(best) + 1)):
        return True, COOPERATIVE
    if side < 0 and _wants_right(n, d, b, slot, row, there, ahead, on_own, on_other):
        return True, 0
    if side > 0 and _wants_left(n, d, b, slot, there, on_own, on_other):
        return True, 0
    # Towards the lane of the route, where it does not cost speed.
    gains = on_other >= on_own and driven.gain[b, slot] * side > 0.0
    return to_best and best == changes and gains, STRATEGIC


@kernel
def _taken_on(n: Traffic, d: Demand, row: int, changes: int) -> float:
    """Return how much vehicles take up of a lane some changes away, and of the two that follow it [m]."""
    while changes != 0:
        beside = d.ways.left[row] if changes > 0 else d.ways.right[row]
        changes -= 1 if changes > 0 else -1
        row = beside if beside >= 0 else row
    taken, count = 0.0, 0
    while row >= 0 and count < 3:
        taken += n.occupancy.taken[d.ways.lane[row]]
        row = d.ways.next[row]
        count += 1
    return float(taken)


@kernel
def _leads_on(n: Traffic, d: Demand, row: int) -> bool:
    """Return whether the last lane that is reached without a change leads anywhere, if not on the route."""
    while d.ways.next[row] >= 0:
        row = d.ways.next[row]
    lane = d.ways.lane[row]
    return bool(n.successor_start[lane] < n.successor_start[lane + 1])


@kernel
def _speeds_up(n: Traffic, b: int, near: Near) -> bool:
    return near[0] >= 0 and n.state.vehicles.acceleration[b, n.occupancy.slot[near[0]]] > 0.0


@kernel
def _thresholds(types: Types, t: int) -> tuple[float, float]:
    """Return the gains from which on drivers of a type change to the left, and to the right."""
    gain = max(types.speed_gain[t], 1e-9)
    return THRESHOLD / gain, RIGHT_THRESHOLD / gain


@kernel
def _wants_right(
    n: Traffic,
    d: Demand,
    b: int,
    slot: int,
    row: int,
    there: float,
    ahead: Near,
    on_own: float,
    on_other: float,
) -> bool:
    """Return whether a driver wants to the right for speed, or since it is free; remember its gain.

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        row: Row of its lane.
        there: How far the lane to the right leads [m].
        ahead: The vehicle ahead there.
        on_own: Speed that it expects on its lane [m/s].
        on_other: Speed on the lane to the right [m/s].
    """
    driven, t = n.driven, n.driven.type[b, slot]
    action, threshold = reaction_of(d.types, t, n.state.dt), _thresholds(d.types, t)[1]
    if on_own - SLOWER > on_other:
        if driven.gain[b, slot] < 0.0:
            driven.gain[b, slot] *= 0.5**action
    else:
        gains = (on_other - on_own) / max(on_other, LEAST_NORM)
        if driven.gain[b, slot] < 0.0 or gains > 0.0:
            driven.gain[b, slot] -= action * gains
        share = _free_on_right(n, d, b, slot, there, ahead, d.ways.lane[row])
        driven.keeping[b, slot] -= action * threshold * share / KEEP_RIGHT_TIME
        if driven.keeping[b, slot] * d.types.keep_right[t] < -threshold:
            return True
    lasts = there > REMAINS * max(0.1, n.state.vehicles.speed[b, slot])
    return lasts and driven.gain[b, slot] < -threshold


@kernel
def _wants_left(
    n: Traffic, d: Demand, b: int, slot: int, there: float, on_own: float, on_other: float
) -> bool:
    """Return whether a driver wants to the left for speed, as `_wants_right` does."""
    driven, t = n.driven, n.driven.type[b, slot]
    action, gains = reaction_of(d.types, t, n.state.dt), (on_other - on_own) / max(on_other, LEAST_NORM)
    if gains > 0.0:
        driven.gain[b, slot] += action * gains
    elif driven.gain[b, slot] > 0.0:
        driven.gain[b, slot] *= (0.8 if on_own == on_other else 0.5) ** action
    lasts = there > REMAINS * max(0.1, n.state.vehicles.speed[b, slot])
    return lasts and driven.gain[b, slot] > _thresholds(d.types, t)[0] and gains > SLACK


@kernel
def _free_on_right(n: Traffic, d: Demand, b: int, slot: int, there: float, ahead: Near, lane: int) -> float:
    """Return how long the lane to the right is free for a driver's speed, as a share of what it wants."""
    most, entry = desired_speed(n, d, b, slot, lane), ahead[0]
    speed, t = n.state.vehicles.speed[b, slot], n.driven.type[b, slot]
    wanted = RIGHT_TIME * most / n.roads.lane_speed[lane] * max(1.0, speed)
    free = max(0.0, there - braking_distance(n, d, b, slot, most, d.types.tau[t]))
    seconds = min(wanted, free / most)
    if entry >= 0 and n.occupancy.pace[entry] < most:
        pace, other = n.occupancy.pace[entry], n.occupancy.slot[entry]
        needed = needed_gap(n, d, b, slot, most, pace, decel_of(n, d, b, other))
        free = max(0.0, min(free, ahead[1] - needed))
        seconds = min(seconds, free / (most - pace))
    return seconds / wanted


@kernel
def _expected_speed(
    n: Traffic, d: Demand, b: int, slot: int, near: Near, room: float, most: float, rising: bool
) -> float:
    """Return the speed that a driver expects on a lane [m/s] (`anticipateFollowSpeed`).

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        near: The vehicle ahead there.
        room: How far the lane leads [m].
        most: Desired speed there [m/s].
        rising: Whether a leader speeds up.
    """
    types, t, dt, ballistic = d.types, n.driven.type[b, slot], n.state.dt, n.ballistic[b]
    speed, decel, tau = n.state.vehicles.speed[b, slot], types.decel[t], types.tau[t]
    leader, gap = near
    if rising:
        soon = min(most, speed + types.accel[t] * dt)
        if leader < 0:
            return min(most, follow_speed(n, d, b, slot, soon, room, 0.0, decel))
        its = decel_of(n, d, b, n.occupancy.slot[leader])
        return min(most, follow_speed(n, d, b, slot, soon, gap, n.occupancy.pace[leader], its))
    if leader < 0:
        return min(most, insertion_stop_speed(room, decel, tau, dt, ballistic))
    its = max(decel, decel_of(n, d, b, n.occupancy.slot[leader]))
    braking = brake_gap(n.occupancy.pace[leader], its, 0.0, dt, ballistic)
    return min(most, insertion_stop_speed(max(gap + braking, 0.0), decel, tau, dt, ballistic))


@kernel
def _prepare(
    n: Traffic,
    d: Demand,
    b: int,
    slot: int,
    side: int,
    best: int,
    space: float,
    ahead: Near,
    behind: Near,
    blocked: int,
) -> None:
    """Prepare a lane change that the route demands: choose a gap, and ask the neighbours for it."""
    driven, types, t = n.driven, d.types, n.driven.type[b, slot]
    driven.space[b, slot] = space
    if abs(best) > 1:
        driven.reserved[b, slot] = max(
            driven.reserved[b, slot], RESERVED_RIGHT if side < 0 else RESERVED_LEFT
        )
    if ahead[0] >= 0:
        _reserve(n, d, b, slot, n.occupancy.slot[ahead[0]], side)
    pace = max(driven.memory[b, slot], SLACK)
    seconds = max(n.state.dt, space / pace / max(1, abs(best)) / URGENCY)
    planned = _ask_leader(n, d, b, slot, ahead[0], ahead[1], seconds, blocked)
    follower, behind_gap = behind
    if follower >= 0 and planned > -1.0:
        if blocked & BY_FOLLOWER:
            _ask_follower(n, d, b, slot, follower, behind_gap, seconds, planned, side)
        elif blocked & BY_LEADER:
            other = n.occupancy.slot[follower]
            its, dt = n.occupancy.pace[follower], n.state.dt
            if n.state.vehicles.owner[b, other] == n.owner:
                first = follow_speed(n, d, b, other, its, behind_gap + dt * planned, planned, types.decel[t])
                room = behind_gap + dt * (planned - first)
                _advise(n, b, other, follow_speed(n, d, b, other, its, room, planned, types.decel[t]))


@kernel
def _reserve(n: Traffic, d: Demand, b: int, slot: int, other: int, side: int) -> None:
    """Keep room at the lane's end for a vehicle ahead that wants the other way, or let it keep room."""
    driven, v = n.driven, n.state.vehicles
    if v.owner[b, other] != n.owner or driven.wish[b, other] != -side:
        return
    needed = v.length[b, other] + d.types.min_gap[driven.type[b, other]]
    if needed <= driven.space[b, slot] - braking_distance(n, d, b, slot, v.speed[b, slot], 0.0):
        driven.reserved[b, slot] = max(driven.reserved[b, slot], needed)
    else:
        own = v.length[b, slot] + d.types.min_gap[driven.type[b, slot]]
        if own <= driven.space[b, other] - braking_distance(n, d, b, other, v.speed[b, other], 0.0):
            driven.reserved[b, other] = max(driven.reserved[b, other], own)


@kernel
def _advise(n: Traffic, b: int, slot: int, speed: float) -> None:
    """Ask a driver for a speed [m/s]."""
    driven = n.driven
    count = driven.advised[b, slot]
    if n.state.vehicles.owner[b, slot] == n.owner and count < ADVICES:
        driven.advice[b, slot, count] = (speed - n.state.vehicles.speed[b, slot]) / n.state.dt
        driven.advised[b, slot] = count + 1


@kernel
def _ask_leader(
    n: Traffic, d: Demand, b: int, slot: int, ahead: int, gap: float, seconds: float, blocked: int
) -> float:
    """Return the speed of a driver that wants in behind a leader, -1 to pass it [m/s] (`informLeader`)."""
    driven, types, t, v, dt = n.driven, d.types, n.driven.type[b, slot], n.state.vehicles, n.state.dt
    speed, ballistic = v.speed[b, slot], n.ballistic[b]
    space = driven.space[b, slot] - driven.reserved[b, slot]
    planned = min(speed, stop_speed(n, d, b, slot, speed, space, types.decel[t]))
    for place in range(driven.advised[b, slot]):
        if driven.advice[b, slot, place] >= -types.decel[t]:
            planned = min(planned, speed + driven.advice[b, slot, place] * dt)
    if ahead < 0:
        return planned
    other, pace = n.occupancy.slot[ahead], n.occupancy.pace[ahead]
    then = pace - dt * max(1.0, -v.acceleration[b, other])
    moved = 0.5 * (pace + then) - 0.5 * (speed + planned) if ballistic else then - planned
    decel = decel_of(n, d, b, other)
    target = follow_speed(n, d, b, slot, speed, gap + dt * moved, max(then, 0.0), decel)
    target = max(lowest_next(types, t, speed, dt, ballistic), target)
    if not blocked & BY_LEADER:
        _advise(n, b, slot, target)
        return min(target, planned)
    way = gap + v.length[b, other] + least_gap(n, d, b, other) + v.length[b, slot]
    way += needed_gap(n, d, b, other, pace, speed, types.decel[t])
    faster = planned - pace
    braking = braking_distance(n, d, b, slot, speed, 0.0 if ballistic else types.tau[t])
    if faster <= 0.0 or space - braking < way or seconds < max(way, 0.0) / faster:
        n.driven.reason[b, other] |= BLOCKS_CHANGE
        if target >= speed:
            _advise(n, b, slot, target)
            return planned
        slower = min(types.decel[t], max(FALL_BACK, (speed - target) / seconds))
        following = min(planned, max(0.0, speed - slower * dt))
        _advise(n, b, slot, following)
        return following
    n.driven.reason[b, other] |= BLOCKS_CHANGE
    _advise(n, b, other, pace)
    return -1.0


@kernel
def _ask_follower(
    n: Traffic,
    d: Demand,
    b: int,
    slot: int,
    behind: int,
    gap: float,
    seconds: float,
    planned: float,
    side: int,
) -> None:
    """Ask the vehicle behind on the lane beside for a gap, or let it pass (`informFollower`)."""
    types, t, v, dt, other = (
        d.types,
        n.driven.type[b, slot],
        n.state.vehicles,
        n.state.dt,
        n.occupancy.slot[behind],
    )
    if v.owner[b, other] != n.owner:
        return
    speed, its, decel = v.speed[b, slot], v.speed[b, other], types.decel[t]
    planned = max(planned, 0.0)
    n.driven.asked[b, other] = side
    lacking = needed_gap(n, d, b, other, its, planned, decel) - gap
    if planned - its >= HELP and lacking / seconds < planned - its:
        _advise(n, b, other, planned - HELP)
        return
    help_decel = decel_of(n, d, b, other)
    slower, after = max(0.0, its - help_decel * dt), max(0.0, its - help_decel)
    opens = speed - its if n.ballistic[b] else planned - after
    wider = gap + (planned - its + 0.5 * help_decel if n.ballistic[b] else opens)
    secure = needed_gap(n, d, b, other, after, planned, decel)
    if wider > 0.0 and wider >= secure:
        first = follow_speed(n, d, b, other, its, gap + dt * planned, planned, decel)
        room = gap + dt * (planned - max(slower, first))
        found = max(slower, follow_speed(n, d, b, other, its, room, planned, decel))
        if n.ballistic[b]:
            found = min(its, found)
            if room < needed_gap(n, d, b, other, found, planned, decel):
                found = slower
        _advise(n, b, other, found)
        return
    if opens > 0.0 and opens * (seconds - 1.0 if n.ballistic[b] else seconds) > secure - wider + 0.1:
        _advise(n, b, other, slower)
        return
    helped = max(its, speed + HELP)
    lane = d.ways.lane[n.driven.row[b, slot]]
    if its > speed and (side < 0 or planned > FAST or n.lane_length[lane] > LONG_LANE):
        helped = max(slower, speed + HELP)
        if (its - speed) / help_decel < seconds:
            _advise(n, b, other, slower if n.ballistic[b] else helped)
            return
    _advise(n, b, other, helped)
    way = gap + v.length[b, slot] + types.min_gap[t] + v.length[b, other]
    way += needed_gap(n, d, b, slot, planned, helped, help_decel)
    _advise(n, b, slot, max(helped - max(way, 0.0) / seconds, speed - decel * dt))
