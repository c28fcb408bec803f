"""Overlaps among traffic: SUMO's drivers may drive through each other, which is no agent's collision."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Bools, Ints
from smarts.geometry.boxes import box_gaps
from smarts.geometry.compiling import kernel
from smarts.roads.levels import meets
from smarts.sim.places import was_there
from smarts.types.vehicles import Owner, VehicleStates
from smarts.types.world import State

LEAST_DEPTH = 0.02
"""Footprints that share less than this along some axis only touch [m]."""

_AGENT = int(Owner.AGENT)


@kernel
def count_overlaps(state: State, overlaps: Ints, env_mask: Bools) -> None:
    """Add the pairs of vehicles of traffic that have come to overlap in this step.

    Args:
        state: State of the world.
        overlaps: Pairs since the episode began, shape (B,); written.
        env_mask: Which simulations made the step, shape (B,).
    """
    now, before = state.vehicles, state.before
    for b in np.flatnonzero(env_mask):
        used = state.used[b]
        slots = np.flatnonzero(now.alive[b, :used] & (now.owner[b, :used] != _AGENT))
        slots = slots[np.argsort(now.position[b, :, 0][slots])]
        longest = 0.0
        for v in slots:
            longest = max(longest, now.length[b, v] + now.width[b, v])
        for place, v in enumerate(slots):
            for w in slots[place + 1 :]:
                if now.position[b, w, 0] - now.position[b, v, 0] > longest:
                    break
                if abs(now.position[b, w, 1] - now.position[b, v, 1]) > longest or not meets(now, b, v, w):
                    continue
                were_there = was_there(now, before, b, v) and was_there(now, before, b, w)
                if _overlap(now, b, v, w) and not (were_there and _overlap(before, b, v, w)):
                    overlaps[b] += 1


@kernel
def _overlap(vehicles: VehicleStates, b: int, v: int, w: int) -> bool:
    """Return whether the footprints of two vehicles overlap."""
    one = vehicles.position[b, v, 0], vehicles.position[b, v, 1], vehicles.heading[b, v]
    other = vehicles.position[b, w, 0], vehicles.position[b, w, 1], vehicles.heading[b, w]
    half, half2 = 0.5 * vehicles.length[b, v], 0.5 * vehicles.length[b, w]
    gaps = box_gaps(one, half, 0.5 * vehicles.width[b, v], other, half2, 0.5 * vehicles.width[b, w])
    return max(gaps) < -LEAST_DEPTH
