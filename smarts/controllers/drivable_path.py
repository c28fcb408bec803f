"""Compiled: the path nearest to a lane that a vehicle can drive, where the lane bends tighter than it can.

The plan is the path of a vehicle's centre from where it is now: curvatures u(s) that minimise the integral of
(offset from the lane)^2 + smoothness (du/ds)^2, with |u| below the vehicle's sharpest curvature (by a penalty).
So it swings wide before a corner that is too tight, by about as much as it cuts inside. Each iteration drives
the present curvatures exactly, measures the offsets, and solves the problem linearised about that way by one
Riccati recursion (Gauss-Newton; Li and Todorov, ICINCO 2004). The change of curvature costs more where the
vehicle is faster, since its steering's rate is bounded; what it still takes, the speed is lowered to.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import project, wrapped
from smarts.roads.arrays import Roads
from smarts.roads.footprints import is_on_road
from smarts.roads.lane_graph import LaneKind

Floats = NDArray[np.float64]

PLANNED = 1.0
"""`Commands.window` of a plan [m]."""
STEP = 1.0
"""Between the points of a plan [m]."""
RADII = 6.0
"""Length of a plan, in turning radii of the vehicle."""
MOST_POINTS = 46
"""Of a plan."""
LOOK_AHEAD = 30
"""Points ahead among which a bend is looked for that is too tight."""
TIGHT_SHARE = 0.9
"""A lane is tight where it bends more than this share of the vehicle's sharpest curvature."""
UNWOUND_SHARE = 0.3
"""The steering is off the lane's by more than this share of the sharpest curvature: it is still to unwind."""
MOST_PASSED = 3
"""Segments of the lane that one step of a plan may pass, so that it leaves no loop out."""
ITERATIONS = 6
SMOOTHNESS = 2.0
"""Cost of a change of the steering along the way, over squared wheelbases, at rest [m^2]."""
SMOOTHNESS_PER_SPEED = 1.0
"""By how much it grows with the square of the speed [s^2/m^2]."""
BOUND_COST = 500.0
"""Of curvature beyond the sharpest, over the sharpest, squared."""
EASY_OFFSET = 0.6
FAR_COST = 10.0
"""Of what offsets are more than `EASY_OFFSET` [m], squared, over that of offsets."""
NEAR_EDGE = 0.8
EDGE_MARGIN = 0.4
EDGE_COST = 100.0
"""Of what offsets are more than `NEAR_EDGE` [m], squared, where the road ends within `EDGE_MARGIN` [m]."""
END_COST = 5.0
"""Of offset and heading [m] at the end of the plan, over that of a point."""
CRAWL = 1.2
"""The least speed to which a plan brakes [m/s]."""
GAIN = 1.5
"""Acceleration that a plan reckons with [m/s^2]."""
_ROAD = 1 << LaneKind.CAR | 1 << LaneKind.BUS
_PURSUED = 4.0
"""Of the pursuit that the first guess comes from [m]."""


@kernel
def is_tight(reference: Floats, curvature: float, sharpest: float) -> bool:
    """Tell whether a lane ahead bends tighter than a vehicle can well drive, or its steering is far off it.

    Args:
        reference: Along the lane, shape (R, 4).
        curvature: Of the vehicle's present course [1/m].
        sharpest: That it can drive [1/m].
    """
    here = wrapped(reference[2, 2] - reference[0, 2]) / (2.0 * STEP)
    if abs(curvature - here) > UNWOUND_SHARE * sharpest:
        return True
    for i in range(min(LOOK_AHEAD, len(reference)) - 2):
        if abs(wrapped(reference[i + 2, 2] - reference[i, 2])) > 2.0 * STEP * TIGHT_SHARE * sharpest:
            return True
    return False


@kernel
def plan_drivable_path(
    roads: Roads,
    world: int,
    reference: Floats,
    pose: tuple[float, float, float],
    curvature: float,
    speed: float,
    sharpest: float,
    wheelbase: float,
    agility: float,
) -> None:
    """Replace the first points of a reference by what the vehicle can drive, and lower their speeds to that.

    Args:
        roads: The maps' lanes.
        world: Map number.
        reference: Along the lane, with its speeds, shape (R, 4); written.
        pose: x, y [m] of the vehicle's centre and its course [rad].
        curvature: Of its course [1/m].
        speed: [m/s]
        sharpest: The largest curvature of its course [1/m].
        wheelbase: [m]
        agility: How fast it can change its curvature [1/(m s)].
    """
    count = min(int(RADII / (sharpest * STEP)), MOST_POINTS, len(reference) - 2)
    bends = np.empty(count)
    smoothness = np.empty(count)
    way = np.empty((count + 1, 3))
    found = np.empty((count + 1, 3))
    for i in range(count):
        pace = min(reference[i, 3], math.sqrt(speed * speed + 2.0 * GAIN * STEP * i))
        smoothness[i] = SMOOTHNESS * wheelbase**2 * (1.0 + SMOOTHNESS_PER_SPEED * pace * pace)
    _pursue(reference, pose, curvature, sharpest, bends)
    for _ in range(ITERATIONS):
        _drive(pose, bends, way)
        _measure(reference, way, found)
        _find_edges(roads, world, way, found)
        _improve(bends, curvature, sharpest, smoothness, found)
    _drive(pose, bends, way)
    last = _measure(reference, way, found)
    _replace(reference, way, bends, curvature, agility, last)


@kernel
def _pursue(
    reference: Floats, pose: tuple[float, float, float], curvature: float, sharpest: float, bends: Floats
) -> None:
    """Write the curvatures of a vehicle that steers for a point ahead: a first guess."""
    x, y, heading = pose
    bend, goal = curvature, 0
    for i in range(len(bends)):
        while goal < len(reference) - 1:
            dx, dy = reference[goal, 0] - x, reference[goal, 1] - y
            if dx * dx + dy * dy >= _PURSUED**2 and dx * math.cos(heading) + dy * math.sin(heading) > 0.0:
                break
            goal += 1
        dx, dy = reference[goal, 0] - x, reference[goal, 1] - y
        turn = wrapped(math.atan2(dy, dx) - heading)
        wanted = 2.0 * math.sin(turn) / max(math.hypot(dx, dy), 1.0)
        wanted = min(max(wanted, -sharpest), sharpest)
        bend += min(max(wanted - bend, -0.5 * sharpest), 0.5 * sharpest)
        bends[i] = bend
        middle = heading + 0.5 * STEP * bend
        x, y = x + STEP * math.cos(middle), y + STEP * math.sin(middle)
        heading += STEP * bend


@kernel
def _drive(pose: tuple[float, float, float], bends: Floats, way: Floats) -> None:
    """Write x, y, heading of the way that some curvatures lead, shape (N + 1, 3)."""
    way[0, 0], way[0, 1], way[0, 2] = pose
    for i in range(len(bends)):
        middle = way[i, 2] + 0.5 * STEP * bends[i]
        way[i + 1, 0] = way[i, 0] + STEP * math.cos(middle)
        way[i + 1, 1] = way[i, 1] + STEP * math.sin(middle)
        way[i + 1, 2] = way[i, 2] + STEP * bends[i]


@kernel
def _measure(reference: Floats, way: Floats, found: Floats) -> int:
    """Write offset and relative heading of a way's points, shape (N + 1, 3); return the last one's segment."""
    segment = 0
    for i in range(len(way)):
        best, best_square, best_cross = segment, np.inf, 0.0
        for point in range(segment, min(segment + MOST_PASSED, len(reference) - 1)):
            a, b = reference[point], reference[point + 1]
            _, square, cross = project(way[i, 0], way[i, 1], a[0], a[1], b[0], b[1])
            if square < best_square:
                best, best_square, best_cross = point, square, cross
        segment = best
        found[i, 0] = math.copysign(math.sqrt(best_square), best_cross)
        found[i, 1] = wrapped(way[i, 2] - reference[segment, 2])
    return segment


@kernel
def _find_edges(roads: Roads, world: int, way: Floats, found: Floats) -> None:
    """Write how far a way's points are beyond where they should be, near the edge of the road; else 0 [m]."""
    for i in range(len(way)):
        found[i, 2] = 0.0
        offset = found[i, 0]
        if abs(offset) > NEAR_EDGE:
            margin = math.copysign(EDGE_MARGIN, offset)
            x, y = way[i, 0] - margin * math.sin(way[i, 2]), way[i, 1] + margin * math.cos(way[i, 2])
            if not is_on_road(roads, world, x, y, _ROAD, True):
                found[i, 2] = math.copysign(abs(offset) - NEAR_EDGE, offset)


@kernel
def _improve(bends: Floats, curvature: float, sharpest: float, smoothness: Floats, found: Floats) -> None:
    """Write better curvatures, from the offsets to which the present ones lead."""
    count = len(bends)
    feedback = np.empty((count, 4))
    value, linear = np.zeros((3, 3)), np.zeros(3)
    product = np.zeros((3, 3))
    for k in range(count - 1, -1, -1):
        weight = END_COST if k == count - 1 else 1.0
        value[0, 0] += weight * STEP
        linear[0] += weight * STEP * found[k + 1, 0]
        far = max(abs(found[k + 1, 0]) - EASY_OFFSET, 0.0)
        if far > 0.0:
            value[0, 0] += FAR_COST * STEP
            linear[0] += math.copysign(FAR_COST * STEP * far, found[k + 1, 0])
        if found[k + 1, 2] != 0.0:
            value[0, 0] += EDGE_COST * STEP
            linear[0] += EDGE_COST * STEP * found[k + 1, 2]
        if k == count - 1:
            value[1, 1] += END_COST
            linear[1] += END_COST * found[k + 1, 1]
        excess = max(abs(bends[k]) - sharpest, 0.0)
        if excess > 0.0:
            cost = BOUND_COST / (sharpest * sharpest)
            value[2, 2] += cost
            linear[2] += math.copysign(cost * excess, bends[k])
        change = bends[k] - (bends[k - 1] if k > 0 else curvature)
        # The state (offset, heading, curvature) goes on as offset + h heading, heading + h curvature.
        to_bend = value[1] * STEP + value[2]
        curving = smoothness[k] / STEP + to_bend[1] * STEP + to_bend[2]
        slope = smoothness[k] / STEP * change + linear[1] * STEP + linear[2]
        gain_0, gain_1 = to_bend[0], to_bend[0] * STEP + to_bend[1]
        gain_2 = to_bend[1] * STEP + to_bend[2]
        feedback[k] = gain_0, gain_1, gain_2, slope
        feedback[k] /= -curving
        for i in range(3):
            product[i, 0] = value[i, 0]
            product[i, 1] = value[i, 0] * STEP + value[i, 1]
            product[i, 2] = value[i, 1] * STEP + value[i, 2]
        for j in range(3):
            value[0, j] = product[0, j]
            value[1, j] = STEP * product[0, j] + product[1, j]
            value[2, j] = STEP * product[1, j] + product[2, j]
        linear[2] += STEP * linear[1]
        linear[1] += STEP * linear[0]
        gains = (gain_0, gain_1, gain_2)
        for i in range(3):
            linear[i] -= gains[i] * slope / curving
            for j in range(3):
                value[i, j] -= gains[i] * gains[j] / curving
    aside, turn, bend = 0.0, 0.0, 0.0
    for k in range(count):
        row = feedback[k]
        bend += row[0] * aside + row[1] * turn + row[2] * bend + row[3]
        aside += STEP * turn
        turn += STEP * bend
        bends[k] += bend


@kernel
def _replace(
    reference: Floats, way: Floats, bends: Floats, curvature: float, agility: float, last: int
) -> None:
    """Write a plan over the first points of a reference; what is behind it follows.

    Args:
        reference: Written.
        way: Its points, shape (N + 1, 3).
        bends: Its curvatures, shape (N,).
        curvature: Before it.
        agility: How fast the vehicle can change its curvature [1/(m s)].
        last: The segment of the reference beside its end.
    """
    count = len(bends)
    rest = reference[last + 1 :].copy()
    for i in range(count + 1):
        reference[i, 0], reference[i, 1], reference[i, 2] = way[i]
        change = abs(bends[min(i, count - 1)] - (bends[i - 1] if i > 0 else curvature)) / STEP
        reference[i, 3] = min(reference[i, 3], max(agility / max(change, 1e-6), CRAWL))
    end = reference[len(reference) - 1].copy()
    for i in range(count + 1, len(reference)):
        source = i - count - 1
        reference[i] = rest[source] if source < len(rest) else end
