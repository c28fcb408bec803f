"""Kernels that decide vehicles' speeds, move them, and write their poses (SUMO's `executeMove`)."""

from __future__ import annotations

import math

import numpy as np

from smarts.dynamics import car_following as cf
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at, wrapped
from smarts.providers.native.draws import DAWDLE, draw
from smarts.providers.native.driving import stop
from smarts.providers.native.junctions import (
    HALTS,
    enters_to_wait,
    ignores_light,
    is_first,
    is_open,
    light_of,
)
from smarts.providers.native.planning import DURATION, VISIBLE
from smarts.providers.native.state import TAILS, Car, Link, Traffic
from smarts.roads.kernels import centre_at, height_at, nearest_segment, place_on
from smarts.types.traffic import Signal

COOPERATIVE, STRATEGIC, BY_LEADER, BY_FOLLOWER, BLOCKS_CHANGE = 1, 2, 4, 8, 16
"""Parts of `Car.reason`: a change for others, or for the route; what blocks it; it blocks another's."""
MERGING_ROOM = 1.0
"""More than a vehicle that wants the other way needs [m]."""
FADES = 0.4
"""How fast a vehicle comes back to the middle of its lane [m/s]."""
ARRIVED = 0.1
"""A vehicle arrives this far before its goal [m]."""
_AMBER = int(Signal.CAUTION)


@kernel
def decide(n: Traffic, car: Car) -> None:
    """Write the speed with which a vehicle ends the step (`processLinkApproaches`, `finalizeSpeed`)."""
    time = n.sims[car.sim].tick * n.dt
    if time < car.next_action - 0.5 * n.dt:
        car.next_speed = car.speed + car.acceleration * n.dt
        return
    car.next_action = time + n.types[car.type].reaction
    safe, least = _pass_links(n, car)
    found = _final_speed(n, car, safe)
    if found > 0.0:
        found = max(found, least)
    car.next_speed = 0.0 if abs(found) < 1e-5 else found


@kernel
def _pass_links(n: Traffic, car: Car) -> tuple[float, float]:
    """Return the highest speed that the links ahead allow, and the lowest that passes the next [m/s]."""
    kind, safe, least, room = n.types[car.type], np.inf, -np.inf, -1.0
    most = cf.highest_next(kind, car.speed)
    car.must_wait = False
    car.will_leave = car.links > 0 and n.links[car.slot, 0].asks
    for number in range(car.links):
        link = n.links[car.slot, number]
        if link.target < 0 or not link.asks:
            if link.target >= 0 and number == 0 and n.lanes[car.lane].inside:
                car.entered = car.conflicted = np.inf
            safe = link.waiting
            car.must_wait = safe < car.speed or safe < HALTS
            break
        passes, is_minor, can_brake = _pass_link(n, car, link)
        if not passes:
            safe, car.must_wait = link.waiting, True
            break
        safe = link.speed
        if is_minor:
            # The speed with which it has come over the line after the step.
            ballistic = (2.0 * link.distance + cf.SLACK) / n.dt - car.speed
            least = min(ballistic if kind.ballistic else (link.distance + 0.1) / n.dt, safe)
            room = link.distance if can_brake else -1.0
        least = min(least, most)
        if safe < min(kind.decel, most) and safe <= link.waiting:
            car.must_wait = True
    if safe + cf.SLACK >= least:
        return safe, least
    if room < 0.0 or safe >= car.speed:
        return safe, safe
    # It would not come across in time, so it stops.
    car.must_wait = True
    return min(safe, max(cf.lowest_next(kind, car.speed), stop(n, car, room))), 0.0


@kernel
def _pass_link(n: Traffic, car: Car, link: Link) -> tuple[bool, bool, bool]:
    """Return whether a vehicle passes a link that it asks to, without priority, and whether it could stop."""
    kind, target, lane = n.types[car.type], n.lanes[n.ways[link.target].lane], n.lanes[n.ways[link.row].lane]
    can_brake = link.distance > cf.brake_gap(kind, car.speed, kind.decel, 0.0) or (
        not kind.ballistic and car.speed < kind.decel * n.dt
    )
    ignores, amber = ignores_light(n, car, target, can_brake), light_of(target) == _AMBER
    if amber and can_brake and not ignores:
        return False, False, can_brake
    gives_way = not (is_first(target) or enters_to_wait(target, lane) or ignores)
    is_minor = target.inside and gives_way
    if amber or is_open(n, car, link, can_brake):
        sees = link.distance <= VISIBLE or not (can_brake or not amber)
        return sees or not is_minor, is_minor, can_brake
    if can_brake or target.lit:
        return False, False, can_brake
    return link.distance < cf.brake_gap(kind, car.speed, kind.hardest, 0.0), False, can_brake


@kernel
def _final_speed(n: Traffic, car: Car, safe: float) -> float:
    """Return a vehicle's speed within its bounds, with dawdling and what neighbours ask for [m/s]."""
    kind, sim = n.types[car.type], n.sims[car.sim]
    hardest = car.speed - kind.hardest * n.dt
    if not kind.ballistic:
        hardest = max(hardest, 0.0)
    lowest = min(cf.lowest_next(kind, car.speed), max(safe, hardest))
    gain = (max(car.desired, safe) - car.speed) * n.dt / kind.reaction
    highest = max(lowest, min(car.speed + gain, cf.highest_next(kind, car.speed), safe))
    wanted = highest
    if not kind.is_idm:
        number = draw(sim.seed, car.number, sim.tick, DAWDLE)
        wanted = max(lowest, cf.dawdled_speed(kind, highest, number))
    return _advised_speed(n, car, lowest, wanted, highest)


@kernel
def _advised_speed(n: Traffic, car: Car, lowest: float, wanted: float, highest: float) -> float:
    """Return a vehicle's speed as lane changes want it [m/s] (`MSLCM_LC2013::patchSpeed`)."""
    kind, lowest, found, is_advised = n.types[car.type], max(lowest, 0.0), wanted, False
    room = car.space - car.reserved - MERGING_ROOM - kind.min_gap
    if car.reserved > 0.0 and room > 0.0:
        hardest, safe = max(car.speed - kind.hardest * n.dt, 0.0), stop(n, car, room)
        highest = min(highest, max(safe, hardest))
        if safe < wanted:
            lowest = max(hardest, safe) if hardest <= safe < lowest else lowest
            found, is_advised = max(lowest, safe), True
    for place in range(car.advised):
        v = car.speed + car.advice[place] * n.dt
        if lowest <= v <= highest:
            weight = car.weight[place]
            found, is_advised = min(found, v * weight + (1.0 - weight) * wanted), True
    if is_advised:
        return found
    is_blocked = car.wish != 0 and car.reason & (BY_LEADER | BY_FOLLOWER) != 0
    if is_blocked and car.reason & COOPERATIVE and not car.reason & STRATEGIC and car.reason & BY_LEADER:
        return 0.5 * (lowest + wanted) if wanted >= 0.0 else wanted
    if (is_blocked and car.reason & (STRATEGIC | COOPERATIVE)) or car.reason & BLOCKS_CHANGE:
        return 0.5 * (highest + wanted)
    return wanted


@kernel
def move(n: Traffic, car: Car) -> None:
    """Move a vehicle along its way and across its lane; dismiss it if it arrives."""
    kind, before, speed = n.types[car.type], car.speed, car.next_speed
    acceleration = (speed - before) / n.dt
    if not kind.ballistic:
        car.front += max(speed, 0.0) * n.dt
    elif speed >= 0.0:
        car.front += 0.5 * (before + speed) * n.dt
    else:
        car.front -= 0.5 * before * before / acceleration
    car.speed = max(speed, 0.0)
    car.acceleration = (car.speed - before) / n.dt
    stands = car.speed <= HALTS and acceleration <= 0.5 * kind.accel
    car.waited = car.waited + n.dt if stands else 0.0
    way = n.ways[car.row]
    car.halted = car.halted + n.dt if stands and car.front >= way.stop_begin else 0.0
    if way.stop < np.inf and (car.halted > way.halt - 0.5 * n.dt or car.front > way.stop + ARRIVED):
        car.row, car.halted = way.next, 0.0
    move_across(n, car)
    _advance(n, car)
    if car.front > n.ways[car.row].arrival - ARRIVED:
        dismiss(n, car)
    if not decides(n, car):
        return
    # Wishes hold until the next decision, those for the route longer.
    if car.reason & STRATEGIC == 0 or car.side != 0:
        car.wish = 0
    car.reason &= STRATEGIC
    car.advised = car.asked = 0
    car.reserved = car.space = 0.0


@kernel
def decides(n: Traffic, car: Car) -> bool:
    """Return whether a vehicle's driver has decided in this step."""
    return car.next_action > (n.sims[car.sim].tick - 0.5) * n.dt + n.types[car.type].reaction - cf.SLACK


@kernel
def move_across(n: Traffic, car: Car) -> None:
    """Carry on a lane change; in its middle the vehicle is on the other lane."""
    if car.side == 0:
        car.offset -= max(-FADES * n.dt, min(FADES * n.dt, car.offset))
        return
    was, to_left = car.done, car.side > 0
    car.done = min(1.0, was + n.dt / DURATION)
    beside = n.ways[car.row].left if to_left else n.ways[car.row].right
    if was < 0.5 <= car.done and beside >= 0:
        lane, other = n.lanes[car.lane], n.lanes[n.ways[beside].lane]
        car.front *= other.length / lane.length
        car.row, car.lane = beside, n.ways[beside].lane
        for tail in range(TAILS):
            if car.tails[tail] >= 0:
                behind = n.lanes[car.tails[tail]]
                car.tails[tail] = behind.left if to_left else behind.right
        car.offset -= car.side * 0.5 * (lane.width + other.width)
    car.offset += car.side * n.lanes[car.lane].width * n.dt / DURATION
    if car.done >= 1.0:
        car.side = 0


@kernel
def _advance(n: Traffic, car: Car) -> None:
    """Put a vehicle onto the lanes ahead that its front has come to."""
    while True:
        way, length = n.ways[car.row], n.lanes[car.lane].length
        if car.front <= length:
            return
        if way.next < 0:
            if way.arrival == np.inf:
                car.front, car.speed, car.acceleration = length, 0.0, 0.0
            return
        following = n.ways[way.next]
        _note_junction(n, car, following.lane)
        for tail in range(TAILS - 1, 0, -1):
            car.tails[tail] = car.tails[tail - 1]
        car.tails[0] = car.lane
        car.front, car.row, car.lane = car.front - length, way.next, following.lane
        to_left = (car.side > 0) == (car.done < 0.5)
        if (following.left if to_left else following.right) < 0:
            car.side = 0


@kernel
def _note_junction(n: Traffic, car: Car, target: int) -> None:
    """Write when a vehicle comes from its lane onto one inside a junction; forget it behind."""
    lane, following, time = n.lanes[car.lane], n.lanes[target], n.sims[car.sim].tick * n.dt
    if not following.inside:
        car.entered = car.first_entered = car.conflicted = np.inf
        return
    if not lane.inside:
        car.entered = car.first_entered = time
    if not enters_to_wait(following, lane):
        car.conflicted, car.entered = time, car.first_entered


@kernel
def dismiss(n: Traffic, car: Car) -> None:
    """Take a vehicle out of its simulation, as `VehicleRegistry.dismiss` does."""
    v, b, slot = n.vehicles, car.sim, car.slot
    v.alive[b, slot] = False
    v.position[b, slot, :] = 0.0
    for column in (v.owner, v.home, v.kind):
        column[b, slot] = 0
    for column in (v.lane, v.route, v.next_edge, v.standing_since):
        column[b, slot] = -1
    for column in (v.height, v.heading, v.speed, v.acceleration, v.length, v.width, v.lane_position):
        column[b, slot] = 0.0
    for column in (v.lane_offset, v.desired_speed, v.lateral_speed, v.lateral_acceleration, v.yaw_rate):
        column[b, slot] = 0.0
    v.yaw_acceleration[b, slot] = 0.0
    n.driven[b, slot] = -1


@kernel
def write_pose(n: Traffic, car: Car, is_new: bool) -> None:
    """Write a vehicle into its columns, both ends on its lanes; without rates of turning if it is new."""
    v, b, slot = n.vehicles, car.sim, car.slot
    x, y, along, height = _point(n, car.lane, car.front, car.offset)
    tail, back = _lane_behind(n, car, car.length)
    back_x, back_y, _, back_height = _point(n, tail, back, car.offset)
    ahead, aside = x - back_x, y - back_y
    apart, heading = math.hypot(ahead, aside), math.atan2(aside, ahead)
    if apart < 0.5 * car.length:
        ahead, aside, apart, heading = math.cos(along), math.sin(along), 1.0, along
    turned = 0.0 if is_new else wrapped(heading - v.heading[b, slot])
    yaw_rate = turned / n.dt
    v.position[b, slot, 0] = x - 0.5 * car.length * ahead / apart
    v.position[b, slot, 1] = y - 0.5 * car.length * aside / apart
    v.height[b, slot], v.heading[b, slot] = 0.5 * (height + back_height), heading
    v.speed[b, slot], v.acceleration[b, slot] = car.speed, car.acceleration
    v.yaw_acceleration[b, slot] = 0.0 if is_new else (yaw_rate - v.yaw_rate[b, slot]) / n.dt
    v.yaw_rate[b, slot], v.lateral_acceleration[b, slot] = yaw_rate, car.speed * yaw_rate
    v.lateral_speed[b, slot] = car.side * n.lanes[car.lane].width / DURATION
    v.desired_speed[b, slot] = car.desired
    _write_place(n, car)


@kernel
def _write_place(n: Traffic, car: Car) -> None:
    """Write the lane and the place there of a vehicle's centre, unless that is over the lane's side."""
    v, roads, b, slot = n.vehicles, n.roads, car.sim, car.slot
    lane, s = _lane_behind(n, car, 0.5 * car.length)
    first, end = roads.point_start[lane], roads.point_start[lane + 1]
    point = segment_at(roads.point_s, first, end, s)
    x, y = v.position[b, slot, 0], v.position[b, slot, 1]
    # In a bend the centre is inside of the lane's line.
    first, last = max(first, point - 1), min(end - 2, point + 1)
    point, _, _, _ = nearest_segment(roads, first, last, x, y, math.nan)
    s, offset, _ = place_on(roads, lane, point, x, y)
    n.placed[b, slot] = abs(offset) <= 0.5 * n.lanes[lane].width
    if n.placed[b, slot]:
        v.lane[b, slot] = lane - roads.lane_base[n.map[b]]
        v.lane_position[b, slot], v.lane_offset[b, slot] = s, offset


@kernel
def _lane_behind(n: Traffic, car: Car, distance: float) -> tuple[int, float]:
    """Return the lane some distance [m] behind a vehicle's front, and the arc length there [m]."""
    lane, s = car.lane, car.front - distance
    for place in range(TAILS):
        if s >= 0.0 or car.tails[place] < 0:
            break
        lane = car.tails[place]
        s += n.lanes[lane].length
    return lane, s


@kernel
def _point(n: Traffic, lane: int, s: float, offset: float) -> tuple[float, float, float, float]:
    """Return x, y [m], heading [rad] and height [m] of a place on a lane, some way to its left."""
    roads = n.roads
    point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
    x, y, heading = centre_at(roads, point, s)
    if offset != 0.0:
        x, y = x - offset * math.sin(heading), y + offset * math.cos(heading)
    return x, y, heading, height_at(roads, point, s)
