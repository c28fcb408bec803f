"""Kernels of the right of way: which vehicles enter a junction, and which let others by inside."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats
from smarts.dynamics.car_following import delayed_arrival
from smarts.geometry.compiling import kernel
from smarts.providers.native.draws import FOE, draw
from smarts.providers.native.driving import decel_of, follow_speed, stop_speed
from smarts.providers.native.state import LINKS, MAJOR, Demand, Traffic
from smarts.roads.lane_graph import ConflictKind, Yields
from smarts.types.traffic import Signal

HALTS = 0.1
"""A slower vehicle halts [m/s]."""
LINE = 0.1
"""A vehicle stops this far before a junction that is full [m]."""
PATIENCE = 180.0
"""A driver that has stood so long is as impatient as can be [s]."""
BLOCKS_AFTER = 5.0
"""Requests are withdrawn for vehicles in the way that have stood so long [s]."""
_MERGE, _THIS, _OTHER, _BOTH = int(ConflictKind.MERGE), int(Yields.THIS), int(Yields.OTHER), int(Yields.BOTH)
LIGHT_GAP, DETECTOR = 3.0, 2.0
"""Gap that ends a phase of a light that waits for gaps, and time ahead at which it notices vehicles [s]."""
_RED, _AMBER, _GO = int(Signal.STOP), int(Signal.CAUTION), int(Signal.GO)


@kernel
def begin_lights(n: Traffic, d: Demand, b: int) -> None:
    """Put the lights of a simulation's map where their programs are at time 0."""
    signals, m = d.signals, n.state.map[b]
    for light in range(signals.map_first[m], signals.map_first[m + 1]):
        phase, left = signals.phases[light], signals.offset[light]
        while left >= signals.least[phase]:
            left -= signals.least[phase]
            phase = phase + 1 if phase < signals.phases[light + 1] - 1 else signals.phases[light]
        d.lights.phase[b, light], d.lights.began[b, light], d.lights.seen[b, light] = phase, -left, -np.inf


@kernel
def show_lights(n: Traffic, d: Demand, b: int, time: float) -> None:
    """Switch the lights of a simulation's map, and write what they show, and for how long they have.

    A phase that may last longer ends where no vehicle that it lets through has come to its detector for
    `LIGHT_GAP` [s].

    Args:
        n: Native traffic, whose lists have the vehicles of the last step.
        d: What scenarios want.
        b: The simulation.
        time: Since the warm-up began [s].
    """
    signals, lights, m = d.signals, d.lights, n.state.map[b]
    for light in range(signals.map_first[m], signals.map_first[m + 1]):
        phase, first = lights.phase[b, light], signals.phases[light]
        lasted = time - lights.began[b, light]
        waits = lasted < signals.most[phase] and time - lights.seen[b, light] < LIGHT_GAP
        if lasted >= signals.least[phase] and not waits:
            phase = phase + 1 if phase < signals.phases[light + 1] - 1 else first
            lights.phase[b, light], lights.began[b, light], lights.seen[b, light] = phase, time, time
    for place in range(signals.lanes[m], signals.lanes[m + 1]):
        light, lane, column = signals.light[place], signals.lane[place], signals.column[place]
        phase = lights.phase[b, light]
        shows = signals.shows[phase, column]
        before = phase - 1 if phase > signals.phases[light] else signals.phases[light + 1] - 1
        is_new = signals.shows[before, column] != shows
        n.occupancy.green[lane] = shows
        n.occupancy.shown[lane] = time - lights.began[b, light] if is_new else np.inf
        n.state.signals[b, lane - n.roads.lane_base[m]] = shows & (MAJOR - 1)
        may_last = shows & (MAJOR - 1) == _GO and signals.most[phase] > signals.least[phase]
        if may_last and _is_detected(n, signals.before[place]):
            lights.seen[b, light] = time


@kernel
def _is_detected(n: Traffic, lane: int) -> bool:
    """Return whether a vehicle is over the detector of a lane, `DETECTOR` [s] before its end."""
    room, place = n.occupancy, max(n.lane_length[lane] - DETECTOR * n.roads.lane_speed[lane], 0.0)
    entry = room.head[lane]
    while entry >= 0:
        if room.back[entry] <= place <= room.front[entry]:
            return True
        entry = room.next[entry]
    return False


@kernel
def light_of(n: Traffic, lane: int) -> int:
    """Return what the light of a lane shows, a `Signal`."""
    return int(n.occupancy.green[lane] & (MAJOR - 1)) if n.lane_signal[lane] else 0


@kernel
def is_first(n: Traffic, lane: int) -> bool:
    """Return whether a lane has the right of way, by signs or its light."""
    if n.lane_signal[lane]:
        return n.occupancy.green[lane] & MAJOR != 0
    return not n.lane_minor[lane]


@kernel
def ignores_light(n: Traffic, d: Demand, b: int, slot: int, lane: int, can_brake: bool) -> bool:
    """Return whether a driver passes a lane's red or amber light (`MSVehicle::ignoreRed`)."""
    t, light, shown = n.driven.type[b, slot], light_of(n, lane), n.occupancy.shown[lane]
    after_red, after_amber = d.types.after_red[t], d.types.after_yellow[t]
    if light == _AMBER:
        return bool(after_red >= 0.0 or (after_amber > 0.0 and (not can_brake or after_amber > shown)))
    return bool(light == _RED and after_red >= 0.0 and (not can_brake or after_red > shown))


@kernel
def impatience(n: Traffic, d: Demand, b: int, slot: int) -> float:
    """Return how little a driver minds that others brake for it, from 0 to 1."""
    found = d.types.impatience[n.driven.type[b, slot]] + n.driven.waited[b, slot] / PATIENCE
    return max(0.0, min(1.0, found))


@kernel
def is_waiting_lane(n: Traffic, lane: int) -> bool:
    """Return whether a lane in a junction ends at a place to wait inside of it."""
    if not n.roads.lane_inside[lane]:
        return False
    following = n.successor_start[lane]
    leads = following < n.successor_start[lane + 1]
    return bool(leads and n.roads.lane_inside[n.successor[following]])


@kernel
def is_open(n: Traffic, d: Demand, b: int, slot: int, link: int, before: int, can_brake: bool) -> bool:
    """Return whether a vehicle may pass a link (`MSLink::opened`).

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        link: Its number among the vehicle's.
        before: The lane before it.
        can_brake: Whether the vehicle can stop before it.
    """
    lane = d.ways.lane[n.links.row[slot, link]]
    if not n.roads.lane_inside[lane]:
        return True
    if is_waiting_lane(n, lane) and not n.roads.lane_inside[before]:
        return True
    if is_first(n, lane):
        return True
    has_light = n.lane_signal[lane]
    patience = impatience(n, d, b, slot) if can_brake else 1.0
    for place in range(n.roads.conflict_start[lane], n.roads.conflict_start[lane + 1]):
        yields = n.roads.conflict_yields[place]
        if not (yields & _THIS or (has_light and is_first(n, n.roads.conflict_lane[place]))):
            continue
        if yields == _BOTH and not has_light and n.driven.waited[b, slot] == 0.0:
            return False
        asks = n.occupancy.approach[n.roads.conflict_lane[place]]
        while asks >= 0:
            other, its = asks // LINKS, asks % LINKS
            if other != slot and _blocks(n, d, b, slot, link, other, its, place, patience):
                return False
            asks = n.links.next[other, its]
    return True


@kernel
def _blocks(
    n: Traffic, d: Demand, b: int, slot: int, link: int, other: int, its: int, place: int, patience: float
) -> bool:
    """Return whether another vehicle's request keeps a driver out of a junction (`MSLink::blockedByFoe`).

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        link: Its link.
        other: The other one.
        its: The other one's link.
        place: Row of their conflict.
        patience: The driver's impatience.
    """
    links, t = n.links, n.driven.type[b, slot]
    arrival, its_arrival = links.arrival[slot, link], links.arrival[other, its]
    if n.roads.conflict_yields[place] == _BOTH:
        waited, its_waited = n.driven.waited[b, slot], n.driven.waited[b, other]
        if waited > its_waited or (waited == its_waited and arrival < its_arrival):
            return False
    decel, its_decel = d.types.decel[t], decel_of(n, d, b, other)
    its_late, its_slow = its_arrival, links.braking_speed[other, its]
    if patience > 0.0 and arrival < its_arrival:
        distance = links.distance[other, its]
        late, slow = delayed_arrival(arrival, its_arrival, distance, its_decel * patience, n.state.dt)
        its_late = (1.0 - patience) * its_arrival + patience * late
        its_slow = slow if slow >= 0.0 else its_slow
    merges = n.roads.conflict_kind[place] == _MERGE
    gap = d.types.time_gap[t]
    if links.leaving[other, its] < arrival:
        its_leaving, speed = links.leaving_speed[other, its], links.arrival_speed[slot, link]
        is_close = arrival - links.leaving[other, its] < gap
        return merges and (is_close or _is_unsafe(its_leaving, speed, its_decel, decel))
    if its_late > links.leaving[slot, link] + gap:
        return merges and _is_unsafe(links.leaving_speed[slot, link], its_slow, decel, its_decel)
    return True


@kernel
def _is_unsafe(leader: float, follower: float, leader_decel: float, decel: float) -> bool:
    """Return whether a follower stops later than its leader where lanes merge (`unsafeMergeSpeeds`)."""
    return leader * leader / leader_decel <= follower * follower / decel


@kernel
def heed_conflicts(
    n: Traffic,
    d: Demand,
    b: int,
    slot: int,
    row: int,
    seen: float,
    v: float,
    v_pass: float,
    waiting: float,
    asks: bool,
) -> tuple[float, float, float, bool]:
    """Return speeds for the vehicles in a junction whose ways meet a lane, and whether the request stands.

    (`MSLink::getLeaderInfo`, `MSVehicle::checkLinkLeader`.)

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        row: Row of its lane inside the junction.
        seen: Distance to the lane's end [m].
        v: Highest speed after the step so far [m/s].
        v_pass: Highest speed at the lane's end so far [m/s].
        waiting: Highest speed if it waits there [m/s].
        asks: Whether it asks to leave the lane.
    """
    lane, last, room = d.ways.lane[row], n.links.total[slot] - 2, n.occupancy
    begin = seen - n.lane_length[lane]
    own_lane = d.ways.lane[n.driven.row[b, slot]]
    for place in range(n.roads.conflict_start[lane], n.roads.conflict_start[lane + 1]):
        merges = n.roads.conflict_kind[place] == _MERGE
        if begin + n.roads.conflict_extent[place, 1] < 0.0 and not merges:
            continue
        entry = room.head[n.roads.conflict_lane[place]]
        while entry >= 0:
            other = room.slot[entry]
            if other != slot:
                matters, gap, crossing = _meeting(n, d, b, slot, place, entry, begin, lane, own_lane)
                if matters:
                    safe = _speed_to_let_by(n, d, b, slot, entry, gap, crossing, begin)
                    if last >= 0:
                        n.links.leaving_speed[slot, last] = min(n.links.leaving_speed[slot, last], safe)
                    v, v_pass = min(v, safe), min(v_pass, safe)
                    if last >= 0:
                        v = max(v, n.links.waiting[slot, last])
                    if v < HALTS and n.driven.waited[b, other] > BLOCKS_AFTER:
                        asks = False
            entry = room.next[entry]
    return v, v_pass, min(waiting, v), asks


@kernel
def _meeting(
    n: Traffic, d: Demand, b: int, slot: int, place: int, entry: int, begin: float, lane: int, own_lane: int
) -> tuple[bool, float, float]:
    """Return whether a driver lets a vehicle inside by, the gap, and the distance to the meeting [m].

    The gap is -infinity where it stops at the meeting in any case, the distance -1 where it stops before the
    lane.

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        place: Row of the conflict.
        entry: Entry of the other vehicle.
        begin: Distance to the begin of the own lane inside the junction [m].
        lane: That lane.
        own_lane: The lane that the vehicle is on.
    """
    roads, room, other = n.roads, n.occupancy, n.occupancy.slot[entry]
    its_lane, merges = roads.conflict_lane[place], roads.conflict_kind[place] == _MERGE
    extent: Floats = roads.conflict_other_extent[place]
    crossing, width = begin + roads.conflict_extent[place, 0], 0.0 if merges else extent[1] - extent[0]
    back, length = extent[0] - room.back[entry], n.state.vehicles.length[b, other]
    is_past = back + width < 0.0
    waits = is_waiting_lane(n, its_lane) and not is_waiting_lane(n, lane)
    is_on = room.front[entry] <= n.lane_length[its_lane]
    in_way = (not is_past and crossing > 0.0) or (merges and crossing > back - length)
    in_way = in_way and back < length and not is_waiting_lane(n, its_lane)
    if not in_way:
        both_green = n.lane_signal[lane] and n.lane_signal[its_lane]
        if (waits and both_green and light_of(n, lane) == light_of(n, its_lane)) or crossing < -LINE:
            return False, 0.0, 0.0
        will_pass = n.state.vehicles.owner[b, other] != n.owner or n.driven.will_leave[b, other]
        if (merges or not waits) and not will_pass and is_on:
            return False, 0.0, 0.0
    gap = -np.inf
    if not waits:
        if is_past and not merges:
            return False, 0.0, 0.0
        gap = crossing - d.types.min_gap[n.driven.type[b, slot]] - back - width
    stops_before = (waits or merges) if is_on else merges
    if not (in_way or _leads(n, d, b, slot, other, place, lane, own_lane)):
        return False, 0.0, 0.0
    ignores = d.types.ignores_foes[n.driven.type[b, slot]]
    if ignores > 0.0 and ignores >= draw(n.seed[b], n.driven.number[b, slot], n.tick[b], FOE):
        return False, 0.0, 0.0
    return True, gap, -1.0 if stops_before else crossing


@kernel
def _leads(
    n: Traffic, d: Demand, b: int, slot: int, other: int, place: int, lane: int, own_lane: int
) -> bool:
    """Return whether another vehicle in the junction goes before a driver (`MSVehicle::isLeader`)."""
    roads, driven = n.roads, n.driven
    if not roads.lane_inside[own_lane] or roads.lane_junction[own_lane] != roads.lane_junction[lane]:
        return True
    its_lane = n.occupancy.other_lane[other]
    if n.state.vehicles.owner[b, other] == n.owner:
        its_lane = d.ways.lane[driven.row[b, other]]
    if its_lane < 0 or not roads.lane_inside[its_lane]:
        return True
    yields = roads.conflict_yields[place]
    responds, its = yields & _THIS != 0, yields & _OTHER != 0
    if n.lane_signal[lane] and is_first(n, lane) != is_first(n, roads.conflict_lane[place]):
        its = is_first(n, lane)
        responds = not its
    # Of a driver that gives way the time counts from where others cross, else from the junction's begin.
    entered = driven.conflicted[b, slot] if responds else driven.entered[b, slot]
    its_entered = driven.entered[b, other] if responds and not its else driven.conflicted[b, other]
    if entered != its_entered:
        return entered > its_entered
    speed, its_speed = n.state.vehicles.speed[b, slot], n.state.vehicles.speed[b, other]
    return slot < other if speed == its_speed else speed < its_speed


@kernel
def _speed_to_let_by(
    n: Traffic, d: Demand, b: int, slot: int, entry: int, gap: float, crossing: float, begin: float
) -> float:
    """Return the speed of a driver that lets a vehicle in the junction by [m/s] (`adaptToJunctionLeader`)."""
    types, t, room, dt = d.types, n.driven.type[b, slot], n.occupancy, n.state.dt
    other, pace, speed = room.slot[entry], room.pace[entry], max(n.state.vehicles.speed[b, slot], 0.0)
    if gap >= 0.0:
        safe = follow_speed(n, d, b, slot, speed, gap, pace, decel_of(n, d, b, other))
    else:
        safe = stop_speed(n, d, b, slot, speed, begin - LINE, types.decel[t])
    if crossing < 0.0:
        return safe
    stop = stop_speed(n, d, b, slot, speed, crossing - types.min_gap[t], types.decel[t])
    if gap == -np.inf:
        return max(safe, stop)
    until_past = (crossing - gap) / max(pace, HALTS)
    if until_past <= 0.0:
        return safe
    then = max(speed, 2.0 * (crossing - types.min_gap[t]) / until_past - speed)
    return max(safe, min(speed + dt * (then - speed) / until_past, stop))
