"""Kernels for a vehicle's reference along the lanes that it follows."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at, wrapped
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, lane_length
from smarts.roads.lane_ways import next_row

NEAR_SPACING = 1.0
"""Spacing of the first `NEAR_POINTS` points of a reference [m]; it then grows by `GROWTH` per point."""
NEAR_POINTS = 32
GROWTH = 1.06

LATERAL_SPEED = 1.3
"""Maximum lateral speed towards the centreline [m/s]."""
LATERAL_TIME = 0.9
"""Time constant of the approach to the centreline [s]."""
STEEPEST = 0.25
"""Maximum slope of a reference against the centreline."""
TRACKED_OFFSET = 0.3
"""The tracking law corrects offsets up to this; for larger ones, references approach the centreline [m]."""

CURVE_ACCELERATION = 3.0
"""Maximum lateral acceleration in curves [m/s^2]."""
BRAKING = 2.0
"""Deceleration before slower points ahead [m/s^2]."""
AGILITY_SHARE = 0.95
"""Share of the steering rate that curves may use; the rest is for feedback."""
LEAST_CURVE_SPEED = 2.0
"""Lower bound of speed limits by curves [m/s]."""


@kernel
def write_reference(
    roads: Roads,
    table: RouteTable,
    map_id: int,
    row: int,
    s: float,
    t: float,
    speed: float,
    cap: float,
    obey_limit: bool,
    agility: float,
    reference: Floats,
) -> None:
    """Write a vehicle's reference along its lane and the lanes after it.

    Args:
        roads: The maps' lanes.
        table: The routes.
        map_id: The map.
        row: The lane's row in `table`.
        s: Arc length of the vehicle on the lane [m].
        t: Offset of the vehicle to the left of the lane [m].
        speed: Speed of the vehicle [m/s].
        cap: Maximum speed [m/s].
        obey_limit: Whether the lanes' speed limits apply too.
        agility: Maximum rate of change of the vehicle's curvature [1/(m s)].
        reference: The reference, written, shape (R, 4), see `Commands`.
    """
    count = len(reference)
    first_lane = roads.lane_base[map_id]
    lane = table.lane[row]
    length = lane_length(roads, lane)
    offset = math.copysign(max(abs(t) - TRACKED_OFFSET, 0.0), t)
    spacing = NEAR_SPACING
    is_over = False
    point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
    last = roads.point_start[lane + 1] - 2
    for i in range(count):
        while s > length and not is_over:
            following = next_row(roads, table, map_id, row, first_lane)
            if following < 0:
                is_over = True
            else:
                row = following
                s -= length
                lane = table.lane[row]
                length = lane_length(roads, lane)
                point, last = int(roads.point_start[lane]), roads.point_start[lane + 1] - 2
        while point < last and roads.point_s[point + 1] <= s:
            point += 1
        x, y, heading = centre_at(roads, point, s)
        slope = 0.0
        if offset != 0.0:
            slope = min(STEEPEST, min(LATERAL_SPEED, abs(offset) / LATERAL_TIME) / max(speed, 4.0))
            slope = -math.copysign(slope, offset)
            x, y = x - offset * math.sin(heading), y + offset * math.cos(heading)
            heading = wrapped(heading + math.atan(slope))
        reference[i, 0], reference[i, 1], reference[i, 2] = x, y, heading
        reference[i, 3] = min(cap, roads.lane_speed[lane]) if obey_limit else cap
        offset += slope * spacing
        s += spacing
        if i >= NEAR_POINTS:
            spacing *= GROWTH
    limit_speeds(reference, count, agility)


@kernel
def limit_speeds(reference: Floats, count: int, agility: float) -> None:
    """Lower a reference's speeds to the limits of its curves, and to braking in time for these.

    Args:
        reference: The reference, shape (R, 4), see `Commands`.
        count: Number of points of the reference.
        agility: Maximum rate of change of the vehicle's curvature [1/(m s)].
    """
    curvature = np.empty(count)
    for i in range(count):
        before, after = max(i - 2, 0), min(i + 2, count - 1)
        turn, curvature[i] = reference[after, 2] - reference[before, 2], 0.0
        if turn != 0.0:  # Most lanes are straight.
            curvature[i] = wrapped(turn) / _span(reference, before, after)
    straight, steady = math.sqrt(CURVE_ACCELERATION / 1e-4), AGILITY_SHARE * agility / 1e-6
    for i in range(count):
        bend = abs(curvature[i])
        fastest = math.sqrt(CURVE_ACCELERATION / bend) if bend > 1e-4 else straight
        before, after = max(i - 3, 0), min(i + 3, count - 1)
        change = abs(curvature[after] - curvature[before])
        change = change / _span(reference, before, after) if change != 0.0 else 0.0
        fastest = min(fastest, AGILITY_SHARE * agility / change if change > 1e-6 else steady)
        reference[i, 3] = min(reference[i, 3], max(fastest, LEAST_CURVE_SPEED))
    for i in range(count - 2, -1, -1):
        a, b = reference[i], reference[i + 1]
        if a[3] > b[3]:
            room = math.hypot(b[0] - a[0], b[1] - a[1])
            reference[i, 3] = min(a[3], math.sqrt(b[3] * b[3] + 2.0 * BRAKING * room))


@kernel
def _span(reference: Floats, before: int, after: int) -> float:
    """Return the distance between two points of a reference, at least 2 m."""
    a, b = reference[before], reference[after]
    return max(math.hypot(b[0] - a[0], b[1] - a[1]), 2.0)
