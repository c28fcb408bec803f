"""Kernels that let vehicles depart (SUMO's `MSInsertionControl` and `MSLane::isInsertionSuccess`)."""

from __future__ import annotations

import numpy as np

from smarts.dynamics.car_following import brake_gap, free_speed, insertion_stop_speed
from smarts.geometry.compiling import kernel
from smarts.providers.native.draws import FACTOR, HEADWAY, PLACE, TYPE, draw, exponential, normal
from smarts.providers.native.driving import decel_of, least_gap, needed_gap
from smarts.providers.native.junctions import is_first, light_of
from smarts.providers.native.occupancy import add_entry, entry_ahead, entry_behind, rearmost
from smarts.providers.native.state import Demand, Traffic
from smarts.types.traffic import Signal

TAIL_SLACK = 0.1
"""A vehicle departs with its tail so far behind its lane's begin [m]."""
TRIES = 20
"""Draws of a speed factor within its bounds."""
_GO = int(Signal.GO)


@kernel
def depart(n: Traffic, d: Demand, b: int, time: float) -> None:
    """Let the vehicles depart whose time has come and that have room.

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        time: Since the warm-up began [s].
    """
    pending, flows, alive = d.pending, d.flows, 0
    for slot in range(n.state.vehicles.alive.shape[1]):
        alive += n.state.vehicles.alive[b, slot]
    for place in range(n.flow_count[b]):
        flow = n.flow_start[b] + place
        while pending.next[b, place] <= time and pending.next[b, place] < flows.end[flow]:
            pending.waiting[b, place] += 1
            headway = flows.headway[flow]
            if flows.is_random[flow]:
                came = pending.came[b, place] + pending.waiting[b, place]
                headway *= exponential(n.seed[b], place, came, HEADWAY)
            pending.next[b, place] += headway
        if pending.waiting[b, place] == 0:
            continue
        if alive >= n.limit[b]:
            n.is_full[b] = True
        elif _depart_one(n, d, b, place, flow):
            pending.waiting[b, place] -= 1
            pending.came[b, place] += 1
            alive += 1


@kernel
def _depart_one(n: Traffic, d: Demand, b: int, place: int, flow: int) -> bool:
    """Let the next vehicle of a flow depart if it has room; return whether it has."""
    flows, types, lane = d.flows, d.types, d.ways.lane[d.flows.row[flow]]
    count, seed = d.pending.came[b, place], n.seed[b]
    chosen, share = flows.mix[flow], draw(seed, place, count, TYPE)
    while chosen < flows.mix[flow + 1] - 1 and flows.mix_share[chosen] <= share:
        chosen += 1
    t, front = flows.mix_type[chosen], flows.place[flow]
    factor = types.factor_mean[t]
    if types.factor_deviation[t] > 0.0:
        for attempt in range(TRIES):
            found = factor + types.factor_deviation[t] * normal(seed, place, TRIES * count + attempt, FACTOR)
            if types.factor_least[t] <= found <= types.factor_most[t]:
                factor = found
                break
    if front == -1.0:
        front = min(types.length[t] + TAIL_SLACK, n.lane_length[lane])
    elif front == -2.0:
        front = draw(seed, place, n.tick[b], PLACE) * n.lane_length[lane]
    wanted = min(n.roads.lane_speed[lane] * factor, types.max_speed[t])
    given = flows.speed[flow]
    speed = _insertion_speed(
        n, d, b, flows.row[flow], t, factor, front, wanted if given < 0.0 else min(given, wanted)
    )
    if speed < 0.0 or (given >= 0.0 and speed < given):
        return False
    behind = entry_behind(n, lane, front, -1)
    if behind >= 0:
        other = n.occupancy.slot[behind]
        gap = front - types.length[t] - n.occupancy.front[behind] - least_gap(n, d, b, other)
        if gap < needed_gap(n, d, b, other, n.occupancy.pace[behind], speed, types.decel[t]):
            return False
    return _admit(n, d, b, flow, t, factor, front, speed)


@kernel
def _insertion_speed(
    n: Traffic, d: Demand, b: int, row: int, t: int, factor: float, front: float, speed: float
) -> float:
    """Return the highest safe speed of a vehicle that departs, -1 if there is no room [m/s].

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        row: Row of its lane.
        t: Its type.
        factor: Its speed factor.
        front: Arc length of its front [m].
        speed: Speed that it wants [m/s].
    """
    types, ways, dt, ballistic = d.types, d.ways, n.state.dt, n.ballistic[b]
    decel, tau, gap = types.decel[t], types.tau[t], types.min_gap[t]
    lane = ways.lane[row]
    seen, ahead = n.lane_length[lane] - front, entry_ahead(n, lane, front, -1)
    while True:
        if ahead >= 0:
            room = seen - n.lane_length[lane] + n.occupancy.back[ahead] - gap
            if room < 0.0:
                return -1.0
            its, pace = decel_of(n, d, b, n.occupancy.slot[ahead]), n.occupancy.pace[ahead]
            room += brake_gap(pace, max(decel, its), 0.0, dt, ballistic)
            return min(speed, insertion_stop_speed(room, decel, tau, dt, ballistic))
        following = ways.next[row]
        if seen > speed * tau + 0.5 * speed * speed / decel + gap or ways.arrival[row] < np.inf:
            return speed
        if following < 0:
            return min(speed, insertion_stop_speed(seen, decel, tau, dt, ballistic))
        target = ways.lane[following]
        light = light_of(n, target)
        if not is_first(n, target) or light not in (0, _GO):
            return min(speed, insertion_stop_speed(seen, decel, tau, dt, ballistic))
        limit = min(n.roads.lane_speed[target] * factor, types.max_speed[t])
        speed = min(speed, max(limit, free_speed(speed, limit, seen, decel, 0.0, dt, ballistic)))
        row, lane, ahead = following, target, rearmost(n, target, -1)
        seen += n.lane_length[lane]


@kernel
def _admit(
    n: Traffic, d: Demand, b: int, flow: int, t: int, factor: float, front: float, speed: float
) -> bool:
    """Give a departing vehicle the lowest free slot; return whether there is one."""
    v, types, slot = n.state.vehicles, d.types, 0
    while slot < v.alive.shape[1] and v.alive[b, slot]:
        slot += 1
    if slot == v.alive.shape[1]:
        n.is_full[b] = True
        return False
    v.alive[b, slot] = True
    v.generation[b, slot] += 1
    v.owner[b, slot] = v.home[b, slot] = n.owner
    v.kind[b, slot], v.height[b, slot] = types.kind[t], np.nan
    v.length[b, slot], v.width[b, slot], v.speed[b, slot] = types.length[t], types.width[t], speed
    row = d.flows.row[flow]
    v.route[b, slot] = d.route_number[b, d.ways.route[row] - n.route_start[b]]
    begin_driving(n, b, slot, t, row, front, factor)
    lane = d.ways.lane[row]
    add_entry(n, lane, slot, front, front - types.length[t], speed)
    return True


@kernel
def begin_driving(n: Traffic, b: int, slot: int, t: int, row: int, front: float, factor: float) -> None:
    """Begin to drive a vehicle.

    Args:
        n: Native traffic.
        b: The simulation.
        slot: The vehicle.
        t: Its type.
        row: Row of its lane.
        front: Arc length of its front [m].
        factor: Its speed factor.
    """
    driven = n.driven
    driven.generation[b, slot] = n.state.vehicles.generation[b, slot]
    driven.last[b, slot], driven.number[b, slot] = n.state.vehicles.generation[b, slot], n.born[b]
    n.born[b] += 1
    driven.type[b, slot], driven.row[b, slot], driven.front[b, slot] = t, row, front
    driven.factor[b, slot] = factor
    driven.tails[b, slot, :] = -1
    driven.side[b, slot] = driven.wish[b, slot] = driven.reason[b, slot] = driven.advised[b, slot] = 0
    driven.asked[b, slot] = 0
    driven.offset[b, slot] = driven.done[b, slot] = driven.waited[b, slot] = 0.0
    driven.gain[b, slot] = driven.keeping[b, slot] = driven.memory[b, slot] = 0.0
    driven.space[b, slot] = driven.reserved[b, slot] = 0.0
    driven.must_wait[b, slot] = driven.will_leave[b, slot] = False
    driven.entered[b, slot] = driven.first_entered[b, slot] = driven.conflicted[b, slot] = np.inf
    driven.next_action[b, slot] = -np.inf
