"""Lights of recorded vehicles: what their drivers would show, found from what they do next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Ints, Longs
from smarts.geometry.frames import wrap_angle
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.episode_files import RecordedEpisode
from smarts.stream.encoder import LIGHTS_SHIFT
from smarts.stream.motion import BRAKES, LEFT, RIGHT

BRAKING = -0.5
"""A vehicle shows its brake lights at this acceleration or below [m/s^2]."""
TURN_ANGLE = 0.4
"""A lane in a junction that bends by more is a turn [rad]."""
BEFORE_TURN = 3.0
"""Turn indicators are on for so long before a turn [s]."""
BEFORE_CHANGE, AFTER_CHANGE = 1.5, 0.7
"""Turn indicators are on for so long before and after a vehicle crosses the line to another lane [s]."""


def recorded_lights(episode: RecordedEpisode, graph: LaneGraph) -> Bytes:
    """Return the lights of each row of `vehicles`: bit 0 brake, 1 left, 2 right; shape (N,)."""
    rows = episode.table("vehicles")
    order = np.lexsort((rows["step"], rows["generation"], rows["slot"]))
    slot, generation = rows["slot"][order], rows["generation"][order]
    first = (np.diff(slot, prepend=-1) != 0) | (np.diff(generation, prepend=-1) != 0)
    flags = indicators(graph, rows["lane"][order], rows["step"][order], first, float(episode.facts["dt"]))
    flags[rows["acceleration"][order] <= BRAKING] |= BRAKES
    lights = np.zeros(len(order), np.int8)
    lights[order] = flags >> LIGHTS_SHIFT
    return lights


def turns_of(graph: LaneGraph) -> Bytes:
    """Return where each lane leads: 1 it turns left, -1 it turns right, 0 neither; shape (L,)."""
    ends = graph.point_heading[graph.point_start[1:] - 1]
    bend = wrap_angle(ends - graph.point_heading[graph.point_start[:-1]])
    return np.where(graph.is_internal & (np.abs(bend) > TURN_ANGLE), np.sign(bend), 0).astype(np.int8)


def indicators(graph: LaneGraph, lane: Ints, step: Ints, first: Bools, dt: float) -> NDArray[np.uint16]:
    """Return the turn indicators of rows, ordered by vehicle and step, as bits of `Motion.flags`.

    Args:
        graph: The map.
        lane: Of each row, -1 where unknown, shape (N,).
        step: Of each row.
        first: Whether the row is the first of its vehicle.
        dt: Length of a step [s].
    """
    turn = np.where(lane >= 0, turns_of(graph)[lane], 0)
    left, right = (_neighbours(each, lane, first) for each in (graph.left, graph.right))
    flags = np.zeros(len(lane), np.uint16)
    vehicle = np.cumsum(first, dtype=np.int64)
    for bit, side, crossed in ((LEFT, 1, left), (RIGHT, -1, right)):
        before, after = round(BEFORE_CHANGE / dt), round(AFTER_CHANGE / dt)
        is_on = _spread(crossed, vehicle, step, before, after)
        is_on |= _spread(turn == side, vehicle, step, round(BEFORE_TURN / dt), 0)
        flags[is_on] |= bit
    return flags


def _neighbours(beside: Ints, lane: Ints, first: Bools) -> Bools:
    """Return which rows are the first on the lane that is beside the lane of the row before."""
    before = np.roll(lane, 1)
    return ~first & (lane >= 0) & (before >= 0) & (beside[before] == lane)


def _spread(chosen: Bools, vehicle: Longs, step: Ints, before: int, after: int) -> Bools:
    """Return which rows are so many steps before or after a chosen one of the same vehicle."""
    if not chosen.any():
        return chosen
    at = (vehicle << 32) + step
    marks = at[chosen]
    following = np.minimum(np.searchsorted(marks, at), len(marks) - 1)
    preceding = np.maximum(np.searchsorted(marks, at, side="right") - 1, 0)
    until, since = marks[following] - at, at - marks[preceding]
    return ((until >= 0) & (until <= before)) | ((since >= 0) & (since <= after))
