"""Kernels of the right of way: which vehicles enter a junction, and which let others by inside."""

from __future__ import annotations

import numpy as np

from smarts.dynamics.car_following import delayed_arrival
from smarts.geometry.compiling import kernel
from smarts.providers.native.draws import FOE, draw
from smarts.providers.native.driving import follow, stop
from smarts.providers.native.state import LINKS, MAJOR, Car, Entry, Lane, Link, Record, Traffic
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
LIGHT_GAP, DETECTOR = 3.0, 2.0
"""Gap that ends a phase of a light that waits for gaps, and time ahead at which it notices vehicles [s]."""
_MERGE, _THIS, _OTHER = int(ConflictKind.MERGE), int(Yields.THIS), int(Yields.OTHER)
_RED, _AMBER, _GO = int(Signal.STOP), int(Signal.CAUTION), int(Signal.GO)


@kernel
def begin_lights(n: Traffic, b: int) -> None:
    """Put the lights of a simulation's map where their programs are at time 0."""
    lights = n.map_lights[n.map[b]]
    for number in range(lights.first, lights.last):
        light, state = n.lights[number], n.light_states[b, number]
        phase, left = light.first, light.offset
        while left >= n.phases[phase].least:
            left -= n.phases[phase].least
            phase = phase + 1 if phase < light.last else light.first
        state.phase, state.began, state.seen = phase, -left, -np.inf


@kernel
def switch_lights(n: Traffic, b: int, time: float) -> None:
    """Switch the lights of a simulation's map; `time` is since the warm-up began [s].

    A phase that may last longer ends where no vehicle that it lets through has come to its detector for
    `LIGHT_GAP` [s].
    """
    lights = n.map_lights[n.map[b]]
    for place in range(lights.first_lit, lights.last_lit):
        lit = n.lit[place]
        state = n.light_states[b, lit.light]
        phase, shows = n.phases[state.phase], n.shows[state.phase, lit.column]
        if phase.most > phase.least and shows & (MAJOR - 1) == _GO and _is_detected(n, lit.before):
            state.seen = time
    for number in range(lights.first, lights.last):
        light, state = n.lights[number], n.light_states[b, number]
        phase, lasted = n.phases[state.phase], time - state.began
        waits = lasted < phase.most and time - state.seen < LIGHT_GAP
        if lasted >= phase.least and not waits:
            state.phase = state.phase + 1 if state.phase < light.last else light.first
            state.began = state.seen = time


@kernel
def show_lights(n: Traffic, b: int, time: float) -> None:
    """Write what the lights of a simulation's map show at a time, and for how long they have."""
    lights, base = n.map_lights[n.map[b]], n.roads.lane_base[n.map[b]]
    for place in range(lights.first_lit, lights.last_lit):
        lit = n.lit[place]
        light, state, lane = n.lights[lit.light], n.light_states[b, lit.light], n.lanes[lit.lane]
        lane.green = n.shows[state.phase, lit.column]
        before = state.phase - 1 if state.phase > light.first else light.last
        lane.shown = time - state.began if n.shows[before, lit.column] != lane.green else np.inf
        n.signals[b, lit.lane - base] = light_of(lane)


@kernel
def _is_detected(n: Traffic, number: int) -> bool:
    """Return whether a vehicle is over the detector of a lane, `DETECTOR` [s] before its end."""
    lane = n.lanes[number]
    place, found = max(lane.length - DETECTOR * lane.speed, 0.0), lane.head
    while found >= 0:
        entry = n.entries[found]
        if entry.back <= place <= entry.front:
            return True
        found = entry.next
    return False


@kernel
def light_of(lane: Lane) -> int:
    """Return what the light of a lane shows, a `Signal`."""
    return int(lane.green & (MAJOR - 1)) if lane.lit else 0


@kernel
def is_first(lane: Lane) -> bool:
    """Return whether a lane has the right of way, by signs or its light."""
    return lane.green & MAJOR != 0 if lane.lit else not lane.minor


@kernel
def ignores_light(n: Traffic, car: Car, lane: Lane, can_brake: bool) -> bool:
    """Return whether a driver passes a lane's red or amber light (`MSVehicle::ignoreRed`)."""
    kind, light = n.types[car.type], light_of(lane)
    if light == _AMBER:
        late = kind.after_yellow > 0.0 and (not can_brake or kind.after_yellow > lane.shown)
        return kind.after_red >= 0.0 or late
    return light == _RED and kind.after_red >= 0.0 and (not can_brake or kind.after_red > lane.shown)


@kernel
def enters_to_wait(lane: Lane, before: Lane) -> bool:
    """Return whether a driver comes from a road onto a lane with a place to wait inside the junction."""
    return lane.waits and not before.inside


@kernel
def is_open(n: Traffic, car: Car, link: Link, can_brake: bool) -> bool:
    """Return whether a vehicle may pass a link (`MSLink::opened`); `can_brake`: it could stop before."""
    number = n.ways[link.target].lane
    lane = n.lanes[number]
    if not lane.inside or enters_to_wait(lane, n.lanes[n.ways[link.row].lane]) or is_first(lane):
        return True
    patience = max(0.0, min(1.0, n.types[car.type].impatience + car.waited / PATIENCE)) if can_brake else 1.0
    for place in range(n.yield_start[number], n.yield_start[number + 1]):
        rule = n.yields[place]
        stops = rule.is_mutual and not lane.lit
        if stops and car.waited == 0.0:
            return False
        asks = n.lanes[rule.foe].approach
        while asks >= 0:
            foe, its = n.cars[car.place - car.slot + asks // LINKS], n.links[asks // LINKS, asks % LINKS]
            is_foe = foe.place != car.place and not (stops and _goes_first(car, link, foe, its))
            if is_foe and _blocks(n, car, link, foe, its, rule.merges, patience):
                return False
            asks = its.next
    return True


@kernel
def _goes_first(car: Car, link: Link, foe: Car, its: Link) -> bool:
    """Return whether a driver goes before another at an all-way stop: it has waited longer, or comes."""
    return car.waited > foe.waited or (car.waited == foe.waited and link.arrival < its.arrival)


@kernel
def _blocks(n: Traffic, car: Car, link: Link, foe: Car, its: Link, merges: bool, patience: float) -> bool:
    """Return whether another vehicle's request keeps a driver out of a junction (`MSLink::blockedByFoe`).

    Args:
        n: Native traffic.
        car: The vehicle.
        link: Its link.
        foe: The other vehicle.
        its: The other one's link.
        merges: Whether both lanes lead into the same one.
        patience: The driver's impatience.
    """
    kind, its_decel = n.types[car.type], n.types[foe.type].decel
    its_late, its_slow = its.arrival, its.braking_speed
    if patience > 0.0 and link.arrival < its.arrival:
        late, slow = delayed_arrival(link.arrival, its.arrival, its.distance, its_decel * patience, n.dt)
        its_late = (1.0 - patience) * its.arrival + patience * late
        its_slow = slow if slow >= 0.0 else its_slow
    if its.leaving < link.arrival:
        is_close = link.arrival - its.leaving < kind.time_gap
        return merges and (
            is_close or _is_unsafe(its.leaving_speed, link.arrival_speed, its_decel, kind.decel)
        )
    if its_late > link.leaving + kind.time_gap:
        return merges and _is_unsafe(link.leaving_speed, its_slow, kind.decel, its_decel)
    return True


@kernel
def _is_unsafe(leader: float, follower: float, leader_decel: float, decel: float) -> bool:
    """Return whether a follower stops later than its leader where lanes merge (`unsafeMergeSpeeds`)."""
    return leader * leader / leader_decel <= follower * follower / decel


@kernel
def heed_conflicts(n: Traffic, car: Car, link: Link) -> None:
    """Slow down for vehicles in a junction whose ways meet a lane (`getLeaderInfo`, `checkLinkLeader`)."""
    number = n.ways[link.row].lane
    lane, last = n.lanes[number], car.links - 1
    begin = link.distance - lane.length
    for place in range(lane.conflicts, n.lanes[number + 1].conflicts):
        conflict = n.conflicts[place]
        if begin + conflict.end < 0.0 and conflict.kind != _MERGE:
            continue
        found = n.lanes[conflict.lane].head
        while found >= 0:
            entry = n.entries[found]
            found = entry.next
            if entry.car == car.place:
                continue
            foe = n.cars[entry.car]
            matters, gap, crossing = _meeting(n, car, foe, entry, conflict, begin, lane)
            if not matters:
                continue
            safe = _speed_to_let_by(n, car, foe, entry.speed, gap, crossing, begin)
            link.speed, link.arrival_speed = min(link.speed, safe), min(link.arrival_speed, safe)
            if last >= 0:
                before = n.links[car.slot, last]
                before.leaving_speed = min(before.leaving_speed, safe)
                link.speed = max(link.speed, before.waiting)
            if link.speed < HALTS and foe.waited > BLOCKS_AFTER:
                link.asks = False
    link.waiting = min(link.waiting, link.speed)


@kernel
def _meeting(
    n: Traffic, car: Car, foe: Car, entry: Entry, conflict: Record, begin: float, lane: Lane
) -> tuple[bool, float, float]:
    """Return whether a driver lets a vehicle inside by, the gap, and the distance to the meeting [m].

    The gap is -infinity where it stops at the meeting in any case, the distance -1 where it stops before the
    lane.

    Args:
        n: Native traffic.
        car: The vehicle.
        foe: The other vehicle.
        entry: The other one's entry.
        conflict: Where the lanes meet.
        begin: Distance to the begin of the own lane inside the junction [m].
        lane: That lane.
    """
    its, kind, merges = n.lanes[conflict.lane], n.types[car.type], conflict.kind == _MERGE
    crossing, width = begin + conflict.begin, 0.0 if merges else conflict.its_end - conflict.its_begin
    back = conflict.its_begin - entry.back
    is_past, is_on = back + width < 0.0, entry.front <= its.length
    waits = its.waits and not lane.waits
    in_way = (not is_past and crossing > 0.0) or (merges and crossing > back - foe.length)
    in_way = in_way and back < foe.length and not its.waits
    if not in_way:
        both_green = lane.lit and its.lit and light_of(lane) == light_of(its)
        if (waits and both_green) or crossing < -LINE:
            return False, 0.0, 0.0
        will_pass = not foe.is_own or foe.will_leave
        if (merges or not waits) and not will_pass and is_on:
            return False, 0.0, 0.0
    gap = -np.inf
    if not waits:
        if is_past and not merges:
            return False, 0.0, 0.0
        gap = crossing - kind.min_gap - back - width
    if not (in_way or _leads(n, car, foe, conflict, lane, its)):
        return False, 0.0, 0.0
    if kind.ignores_foes > 0.0:
        sim = n.sims[car.sim]
        if kind.ignores_foes >= draw(sim.seed, car.number, sim.tick, FOE):
            return False, 0.0, 0.0
    stops_before = merges or (waits and is_on)
    return True, gap, -1.0 if stops_before else crossing


@kernel
def _leads(n: Traffic, car: Car, foe: Car, conflict: Record, lane: Lane, its: Lane) -> bool:
    """Return whether another vehicle in the junction goes before a driver (`MSVehicle::isLeader`)."""
    own = n.lanes[car.lane]
    if not own.inside or own.junction != lane.junction:
        return True
    if foe.lane < 0 or not n.lanes[foe.lane].inside:
        return True
    responds, it_responds = conflict.yields & _THIS != 0, conflict.yields & _OTHER != 0
    if lane.lit and is_first(lane) != is_first(its):
        it_responds = is_first(lane)
        responds = not it_responds
    # Of a driver that gives way the time counts from where others cross, else from the junction's begin.
    entered = car.conflicted if responds else car.entered
    its_entered = foe.entered if responds and not it_responds else foe.conflicted
    if entered != its_entered:
        return entered > its_entered
    return car.place < foe.place if car.speed == foe.speed else car.speed < foe.speed


@kernel
def _speed_to_let_by(
    n: Traffic, car: Car, foe: Car, pace: float, gap: float, crossing: float, begin: float
) -> float:
    """Return the speed of a driver that lets a vehicle in the junction by [m/s] (`adaptToJunctionLeader`)."""
    least = n.types[car.type].min_gap
    safe = follow(n, car, gap, car.speed, foe, pace) if gap >= 0.0 else stop(n, car, begin - LINE)
    if crossing < 0.0:
        return safe
    stopping = stop(n, car, crossing - least)
    if gap == -np.inf:
        return max(safe, stopping)
    until_past = (crossing - gap) / max(pace, HALTS)
    if until_past <= 0.0:
        return safe
    then = max(car.speed, 2.0 * (crossing - least) / until_past - car.speed)
    return max(safe, min(car.speed + n.dt * (then - car.speed) / until_past, stopping))
