"""Kernels that decide vehicles' speeds and move them (SUMO's `executeMove`)."""

from __future__ import annotations

import numpy as np

from smarts.dynamics.car_following import SLACK, brake_gap, dawdled_speed
from smarts.geometry.compiling import kernel
from smarts.providers.native.draws import DAWDLE, draw
from smarts.providers.native.driving import desired_speed, highest_next, lowest_next, reaction_of, stop_speed
from smarts.providers.native.junctions import (
    HALTS,
    ignores_light,
    is_first,
    is_open,
    is_waiting_lane,
    light_of,
)
from smarts.providers.native.planning import DURATION, VISIBLE
from smarts.providers.native.state import TAILS, Demand, Traffic
from smarts.types.traffic import Signal

COOPERATIVE, STRATEGIC, BY_LEADER, BY_FOLLOWER, BLOCKS_CHANGE = 1, 2, 4, 8, 16
"""Parts of `Driven.reason`: a change for others, or for the route; what blocks it; it blocks another's."""
MERGING_ROOM = 1.0
"""More than a vehicle that wants the other way needs [m]."""
FADES = 0.4
"""How fast a vehicle comes back to the middle of its lane [m/s]."""
ARRIVED = 0.1
"""A vehicle arrives this far before its goal [m]."""
_AMBER = int(Signal.CAUTION)


@kernel
def decide(n: Traffic, d: Demand, b: int, slot: int) -> None:
    """Write the speed with which a vehicle ends the step (`processLinkApproaches`, `finalizeSpeed`)."""
    dt, time = n.state.dt, n.tick[b] * n.state.dt
    speed, t = max(n.state.vehicles.speed[b, slot], 0.0), n.driven.type[b, slot]
    if time < n.driven.next_action[b, slot] - 0.5 * dt:
        n.occupancy.speed[slot] = speed + n.state.vehicles.acceleration[b, slot] * dt
        return
    n.driven.next_action[b, slot] = time + reaction_of(d.types, t, dt)
    safe, least = _pass_links(n, d, b, slot, speed)
    found = _final_speed(n, d, b, slot, speed, safe)
    if found > 0.0:
        found = max(found, least)
    n.occupancy.speed[slot] = 0.0 if abs(found) < 1e-5 else found


@kernel
def _pass_links(n: Traffic, d: Demand, b: int, slot: int, speed: float) -> tuple[float, float]:
    """Return the highest speed that the links ahead allow, and the lowest that passes the next [m/s]."""
    links, driven, lane = n.links, n.driven, d.ways.lane[n.driven.row[b, slot]]
    safe, least, room = np.inf, -np.inf, -1.0
    driven.must_wait[b, slot] = False
    driven.will_leave[b, slot] = links.total[slot] > 0 and links.asks[slot, 0]
    for link in range(links.total[slot]):
        row, waiting = links.row[slot, link], links.waiting[slot, link]
        if row < 0 or not links.asks[slot, link]:
            if row >= 0 and link == 0 and n.roads.lane_inside[lane]:
                driven.entered[b, slot] = driven.conflicted[b, slot] = np.inf
            safe = waiting
            driven.must_wait[b, slot] = safe < speed or safe < HALTS
            break
        passes, is_minor, can_brake = _pass_link(n, d, b, slot, link, lane, speed)
        if not passes:
            safe, driven.must_wait[b, slot] = waiting, True
            break
        safe = links.speed[slot, link]
        if is_minor:
            least = min(_speed_to_reach(n, b, links.distance[slot, link], speed), safe)
            room = links.distance[slot, link] if can_brake else -1.0
        most = highest_next(d.types, driven.type[b, slot], speed, n.state.dt)
        least = min(least, most)
        if safe < min(d.types.decel[driven.type[b, slot]], most) and safe <= waiting:
            driven.must_wait[b, slot] = True
        lane = d.ways.lane[row]
    if safe + SLACK >= least:
        return safe, least
    if room < 0.0 or safe >= speed:
        return safe, safe
    # It would not come across in time, so it stops.
    t, driven.must_wait[b, slot] = driven.type[b, slot], True
    stop = stop_speed(n, d, b, slot, speed, room, d.types.decel[t])
    lowest = lowest_next(d.types, t, speed, n.state.dt, n.ballistic[b])
    return min(safe, max(lowest, stop)), 0.0


@kernel
def _pass_link(
    n: Traffic, d: Demand, b: int, slot: int, link: int, lane: int, speed: float
) -> tuple[bool, bool, bool]:
    """Return whether a vehicle passes a link that it asks to, without priority, and whether it could stop.

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        link: Its number among the vehicle's.
        lane: The lane before it.
        speed: The vehicle's [m/s].
    """
    types, t, dt, ballistic = d.types, n.driven.type[b, slot], n.state.dt, n.ballistic[b]
    target, distance = d.ways.lane[n.links.row[slot, link]], n.links.distance[slot, link]
    braking = brake_gap(speed, types.decel[t], 0.0, dt, ballistic)
    can_brake = bool(distance > braking or (not ballistic and speed < types.decel[t] * dt))
    ignores, amber = ignores_light(n, d, b, slot, target, can_brake), light_of(n, target) == _AMBER
    if amber and can_brake and not ignores:
        return False, False, can_brake
    waits_inside = is_waiting_lane(n, target) and not n.roads.lane_inside[lane]
    is_minor = bool(n.roads.lane_inside[target] and not (is_first(n, target) or waits_inside or ignores))
    if amber or is_open(n, d, b, slot, link, lane, can_brake):
        sees = bool(distance <= VISIBLE or not (can_brake or not amber))
        return sees or not is_minor, is_minor, can_brake
    if can_brake or n.lane_signal[target]:
        return False, False, can_brake
    return bool(distance < brake_gap(speed, types.hardest[t], 0.0, dt, ballistic)), False, can_brake


@kernel
def _speed_to_reach(n: Traffic, b: int, distance: float, speed: float) -> float:
    """Return the speed after a step that takes a vehicle over a distance in it [m/s]."""
    dt = n.state.dt
    return (2.0 * distance + SLACK) / dt - speed if n.ballistic[b] else (distance + 0.1) / dt


@kernel
def _final_speed(n: Traffic, d: Demand, b: int, slot: int, speed: float, safe: float) -> float:
    """Return a vehicle's speed within its bounds, with dawdling and what neighbours ask for [m/s]."""
    types, t, dt, ballistic = d.types, n.driven.type[b, slot], n.state.dt, n.ballistic[b]
    hardest = speed - types.hardest[t] * dt
    if not ballistic:
        hardest = max(hardest, 0.0)
    lowest = min(lowest_next(types, t, speed, dt, ballistic), max(safe, hardest))
    desired = desired_speed(n, d, b, slot, d.ways.lane[n.driven.row[b, slot]])
    gain = (max(desired, safe) - speed) * dt / reaction_of(types, t, dt)
    highest = max(lowest, min(speed + gain, highest_next(types, t, speed, dt), safe))
    wanted = highest
    if not types.is_idm[t]:
        number = draw(n.seed[b], n.driven.number[b, slot], n.tick[b], DAWDLE)
        wanted = max(lowest, dawdled_speed(highest, types.sigma[t], types.accel[t], number, dt))
    return _advised_speed(n, d, b, slot, speed, lowest, wanted, highest)


@kernel
def _advised_speed(
    n: Traffic, d: Demand, b: int, slot: int, speed: float, lowest: float, wanted: float, highest: float
) -> float:
    """Return a vehicle's speed as lane changes want it [m/s] (`MSLCM_LC2013::patchSpeed`)."""
    driven, types, t, dt = n.driven, d.types, n.driven.type[b, slot], n.state.dt
    lowest, found, is_advised = max(lowest, 0.0), wanted, False
    if driven.reserved[b, slot] > 0.0:
        room = driven.space[b, slot] - driven.reserved[b, slot] - MERGING_ROOM - types.min_gap[t]
        if room > 0.0:
            hardest = max(speed - types.hardest[t] * dt, 0.0)
            safe = stop_speed(n, d, b, slot, speed, room, types.decel[t])
            highest = min(highest, max(safe, hardest))
            if safe < wanted:
                lowest = max(hardest, safe) if hardest <= safe < lowest else lowest
                found, is_advised = max(lowest, safe), True
    weight = max(0.0, min(1.0, types.cooperative[t]))
    for place in range(driven.advised[b, slot]):
        v = speed + driven.advice[b, slot, place] * dt
        if lowest <= v <= highest:
            found, is_advised = min(found, v * weight + (1.0 - weight) * wanted), True
    reason = driven.reason[b, slot]
    if is_advised:
        return found
    blocked = driven.wish[b, slot] != 0 and reason & (BY_LEADER | BY_FOLLOWER)
    if blocked and reason & STRATEGIC:
        return 0.5 * (highest + wanted)
    if blocked and reason & COOPERATIVE:
        if reason & BY_LEADER:
            return 0.5 * (lowest + wanted) if wanted >= 0.0 else wanted
        return 0.5 * (highest + wanted)
    return 0.5 * (highest + wanted) if reason & BLOCKS_CHANGE else wanted


@kernel
def move(n: Traffic, d: Demand, b: int, slot: int) -> None:
    """Move a vehicle along its way and across its lane; dismiss it if it arrives."""
    vehicles, driven, dt = n.state.vehicles, n.driven, n.state.dt
    before, speed = max(vehicles.speed[b, slot], 0.0), n.occupancy.speed[slot]
    acceleration = (speed - before) / dt
    if not n.ballistic[b]:
        way = max(speed, 0.0) * dt
    elif speed >= 0.0:
        way = 0.5 * (before + speed) * dt
    else:
        way = -0.5 * before * before / acceleration
    speed = max(speed, 0.0)
    driven.front[b, slot] += way
    vehicles.speed[b, slot], vehicles.acceleration[b, slot] = speed, (speed - before) / dt
    t = driven.type[b, slot]
    stands = speed <= HALTS and acceleration <= 0.5 * d.types.accel[t]
    driven.waited[b, slot] = driven.waited[b, slot] + dt if stands else 0.0
    _move_across(n, d, b, slot)
    _advance(n, d, b, slot)
    row = driven.row[b, slot]
    if driven.front[b, slot] > d.ways.arrival[row] - ARRIVED:
        dismiss(n, b, slot)
    # Wishes hold until the next lane change, those for the route longer.
    if driven.reason[b, slot] & STRATEGIC == 0 or driven.side[b, slot] != 0:
        driven.wish[b, slot] = 0
    driven.reason[b, slot] &= STRATEGIC
    driven.advised[b, slot], driven.asked[b, slot], driven.reserved[b, slot], driven.space[b, slot] = (
        0,
        0,
        0.0,
        0.0,
    )


@kernel
def _move_across(n: Traffic, d: Demand, b: int, slot: int) -> None:
    """Carry on a lane change; in its middle the vehicle is on the other lane."""
    driven, roads, side, dt = n.driven, n.roads, n.driven.side[b, slot], n.state.dt
    row = driven.row[b, slot]
    if side == 0:
        offset = driven.offset[b, slot]
        driven.offset[b, slot] = offset - max(-FADES * dt, min(FADES * dt, offset))
        return
    was = driven.done[b, slot]
    driven.done[b, slot] = min(1.0, was + dt / DURATION)
    lane = d.ways.lane[row]
    beside = d.ways.left[row] if side > 0 else d.ways.right[row]
    if was < 0.5 <= driven.done[b, slot] and beside >= 0:
        other = d.ways.lane[beside]
        driven.front[b, slot] *= n.lane_length[other] / n.lane_length[lane]
        driven.row[b, slot] = beside
        for tail in range(TAILS):
            behind = driven.tails[b, slot, tail]
            if behind >= 0:
                driven.tails[b, slot, tail] = (
                    roads.lane_left[behind] if side > 0 else roads.lane_right[behind]
                )
        driven.offset[b, slot] -= side * 0.5 * (roads.lane_width[lane] + roads.lane_width[other])
        lane = other
    driven.offset[b, slot] += side * roads.lane_width[lane] * dt / DURATION
    if driven.done[b, slot] >= 1.0:
        driven.side[b, slot] = 0


@kernel
def _advance(n: Traffic, d: Demand, b: int, slot: int) -> None:
    """Put a vehicle onto the lanes ahead that its front has come to."""
    driven, ways = n.driven, d.ways
    while True:
        row = driven.row[b, slot]
        lane, following = ways.lane[row], ways.next[row]
        over = driven.front[b, slot] - n.lane_length[lane]
        if over <= 0.0:
            return
        if following < 0:
            if ways.arrival[row] == np.inf:
                driven.front[b, slot] = n.lane_length[lane]
                n.state.vehicles.speed[b, slot] = n.state.vehicles.acceleration[b, slot] = 0.0
            return
        driven.front[b, slot], driven.row[b, slot] = over, following
        for tail in range(TAILS - 1, 0, -1):
            driven.tails[b, slot, tail] = driven.tails[b, slot, tail - 1]
        driven.tails[b, slot, 0] = lane
        _note_junction(n, b, slot, lane, ways.lane[following])
        side = driven.side[b, slot]
        if side != 0:
            other = side if driven.done[b, slot] < 0.5 else -side
            beside = ways.left[following] if other > 0 else ways.right[following]
            if beside < 0:
                driven.side[b, slot] = 0


@kernel
def _note_junction(n: Traffic, b: int, slot: int, lane: int, target: int) -> None:
    """Write when a vehicle has come from a lane onto one inside a junction; forget it behind."""
    driven, time = n.driven, n.tick[b] * n.state.dt
    if not n.roads.lane_inside[target]:
        driven.entered[b, slot] = driven.first_entered[b, slot] = driven.conflicted[b, slot] = np.inf
        return
    if not n.roads.lane_inside[lane]:
        driven.entered[b, slot] = driven.first_entered[b, slot] = time
    if n.roads.lane_inside[lane] or not is_waiting_lane(n, target):
        driven.conflicted[b, slot] = time
        driven.entered[b, slot] = driven.first_entered[b, slot]


@kernel
def dismiss(n: Traffic, b: int, slot: int) -> None:
    """Take a vehicle out of its simulation, as `VehicleRegistry.dismiss` does."""
    v = n.state.vehicles
    v.alive[b, slot] = False
    v.owner[b, slot], v.home[b, slot], v.kind[b, slot] = 0, 0, 0
    v.position[b, slot, 0] = v.position[b, slot, 1] = v.height[b, slot] = v.heading[b, slot] = 0.0
    v.speed[b, slot] = v.acceleration[b, slot] = v.length[b, slot] = v.width[b, slot] = 0.0
    v.lane_position[b, slot] = v.lane_offset[b, slot] = v.desired_speed[b, slot] = 0.0
    v.lateral_speed[b, slot] = v.lateral_acceleration[b, slot] = 0.0
    v.yaw_rate[b, slot] = v.yaw_acceleration[b, slot] = 0.0
    v.lane[b, slot] = v.route[b, slot] = v.next_edge[b, slot] = v.standing_since[b, slot] = -1
    n.driven.generation[b, slot] = -1
