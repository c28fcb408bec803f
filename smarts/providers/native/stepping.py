"""The kernels of a step of native traffic, for all simulations."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Bools
from smarts.geometry.boxes import box_gaps
from smarts.geometry.compiling import kernel
from smarts.providers.native.changing import change_lanes
from smarts.providers.native.departing import depart
from smarts.providers.native.draws import HEADWAY, exponential
from smarts.providers.native.junctions import begin_lights, show_lights
from smarts.providers.native.moving import decide, dismiss, move
from smarts.providers.native.occupancy import clear_lists, is_driven, list_vehicles, rearmost
from smarts.providers.native.planning import check_room, clear_requests, plan, register, register_other
from smarts.providers.native.poses import write_poses
from smarts.providers.native.state import Demand, Traffic

MARGIN, ASIDE = 10.0, 1.0
"""Room that vehicles which are there at the reset get before and behind, and on either side [m]."""


@kernel
def step(n: Traffic, d: Demand, env_mask: Bools) -> None:
    """Advance the simulations in a mask, shape (B,), by a step; the order of the lines is that of SUMO."""
    for b in range(len(env_mask)):
        if env_mask[b]:
            _step(n, d, b, True)
            write_poses(n, d, b, False)


@kernel
def begin(n: Traffic, d: Demand, b: int, steps: int) -> None:
    """Begin an episode: drive the warm-up, without other providers' vehicles, then make room for them.

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        steps: Number of steps of the warm-up.
    """
    n.tick[b] = n.born[b] = 0
    n.is_full[b] = False
    n.driven.generation[b, :] = n.driven.last[b, :] = -1
    n.driven.listed[b, 0] = 0
    n.driven.entered[b, :] = n.driven.conflicted[b, :] = np.inf
    n.driven.must_wait[b, :] = False
    for place in range(n.flow_count[b]):
        flow = n.flow_start[b] + place
        d.pending.waiting[b, place] = d.pending.came[b, place] = 0
        d.pending.next[b, place] = d.flows.begin[flow]
        if d.flows.is_random[flow]:
            d.pending.next[b, place] += d.flows.headway[flow] * exponential(n.seed[b], place, 0, HEADWAY)
    begin_lights(n, d, b)
    for _ in range(steps):
        _step(n, d, b, False)
    write_poses(n, d, b, True)
    _make_room(n, b)


@kernel
def _step(n: Traffic, d: Demand, b: int, others: bool) -> None:
    """Advance one simulation; `others` says whether other providers' vehicles are there."""
    driven, order = n.driven, n.driven.order[b]
    # The time at which SUMO's step begins; the slack is against rounding.
    time = n.tick[b] * n.state.dt + 1e-9
    n.tick[b] += 1
    list_vehicles(n, d, b, others)
    show_lights(n, d, b, time)
    clear_requests(n)
    for place in range(driven.listed[b, 0]):
        plan(n, d, b, order[place])
        check_room(n, d, b, order[place], _lengths_ahead(n, d, b, order[place]))
    for slot in range(len(order)):
        if is_driven(n, b, slot):
            register(n, d, b, slot)
        elif others and n.state.vehicles.alive[b, slot]:
            register_other(n, b, slot)
    for place in range(driven.listed[b, 0]):
        decide(n, d, b, order[place])
    for place in range(driven.listed[b, 0]):
        move(n, d, b, order[place])
    clear_lists(n)
    list_vehicles(n, d, b, others)
    change_lanes(n, d, b)
    depart(n, d, b, time)
    clear_lists(n)


@kernel
def _lengths_ahead(n: Traffic, d: Demand, b: int, slot: int) -> float:
    """Return the lengths with gaps of the vehicles ahead of one on its lane [m]."""
    room, lane, total = n.occupancy, d.ways.lane[n.driven.row[b, slot]], 0.0
    entry = rearmost(n, lane, slot)
    while entry >= 0:
        if n.driven.front[b, slot] < room.front[entry] <= n.lane_length[lane] and room.slot[entry] != slot:
            total += room.front[entry] - room.back[entry] + 2.5
        entry = room.next[entry]
    return float(total)


@kernel
def _make_room(n: Traffic, b: int) -> None:
    """Dismiss the engine's vehicles that are too near to those of other providers."""
    v = n.state.vehicles
    for slot in range(v.alive.shape[1]):
        if not is_driven(n, b, slot):
            continue
        own = (v.position[b, slot, 0], v.position[b, slot, 1], v.heading[b, slot])
        for other in range(v.alive.shape[1]):
            if not v.alive[b, other] or v.owner[b, other] == n.owner:
                continue
            there = (v.position[b, other, 0], v.position[b, other, 1], v.heading[b, other])
            reach = math.hypot(own[0] - there[0], own[1] - there[1])
            if reach > v.length[b, slot] + v.length[b, other] + MARGIN:
                continue
            half, half_width = 0.5 * v.length[b, other] + MARGIN, 0.5 * v.width[b, other] + ASIDE
            if (
                max(box_gaps(own, 0.5 * v.length[b, slot], 0.5 * v.width[b, slot], there, half, half_width))
                < 0.0
            ):
                dismiss(n, b, slot)
                break
