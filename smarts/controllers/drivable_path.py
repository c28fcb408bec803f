"""Kernels that plan a drivable path near a lane that bends tighter than the vehicle can.

A plan is a path of the rear axle from its current pose. Its curvatures u(s) minimise the integral of (offset
of the centre from the lane)^2 + smoothness (du/ds)^2, with |u| bounded by the steering lock. Large offsets
and offsets near the edge of the road have extra costs. So a vehicle swings wide before a turn that is too
tight, about as far as it cuts inside, and farther on wider roads. Each iteration simulates the current
curvatures, measures the offsets, and solves the problem linearised about this path by one Riccati recursion
(Gauss-Newton; Li and Todorov, ICINCO 2004). The cost of a change of curvature grows with the speed, since the
steering rate is bounded; speeds are lowered where the plan needs a higher rate.
"""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.dynamics.performance import Abilities
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import project, wrapped
from smarts.roads.arrays import Roads
from smarts.roads.footprints import is_on_road
from smarts.roads.lane_graph import LaneKind

PLANNED = 1.0
"""`Commands.window` of a plan [m]."""
STEP = 1.0
"""Spacing of a plan's points [m]."""
RADII = 6.0
"""Length of a plan, in turning radii of the vehicle."""
MOST_POINTS = 46
"""Maximum number of a plan's points."""
LOOK_AHEAD = 30
"""Number of points ahead that are checked for tight bends."""
TIGHT_SHARE = 0.93
"""A lane is tight if its curvature exceeds this share of the vehicle's maximum curvature."""
UNWOUND_SHARE = 0.3
"""The steering is wound if its curvature differs from the lane's by this share of the maximum curvature."""
MOST_PASSED = 3
"""Maximum number of lane segments that one step of a plan passes, so that a plan does not skip a loop."""
RESERVED = 0.92
"""Share of the maximum curvature that plans use; the rest is for feedback."""
ITERATIONS = 6
SMOOTHNESS = 2.0
"""Cost of a change of curvature at rest, divided by the squared wheelbase [m^2]."""
SMOOTHNESS_PER_SPEED = 1.0
"""Growth of this cost with the squared speed [s^2/m^2]."""
BOUND_COST = 200.0
"""Cost of curvature beyond the maximum, relative to the maximum, squared."""
EASY_OFFSET = 0.6
FAR_COST = 10.0
"""Additional cost of the part of an offset beyond `EASY_OFFSET` [m], squared; offsets themselves cost 1."""
EDGE_MARGIN = 0.5
"""Distance between a vehicle's centre and the edge of the road [m]."""
LEAST_ROOM, MOST_ROOM, ROOM_STEP = 0.8, 3.2, 0.4
"""Minimum, maximum and step of the room beside a lane's centreline, up to this margin [m]."""
EDGE_COST = 100.0
"""Cost of the part of an offset beyond this room [m], squared."""
END_COST = 5.0
"""Cost of offset and heading at the end of a plan, relative to the other points."""
CRAWL = 1.2
"""Lower bound of a plan's speeds [m/s]."""
GAIN = 1.5
"""Assumed acceleration along a plan [m/s^2]."""
_ROAD = 1 << LaneKind.CAR | 1 << LaneKind.BUS
_PURSUED = 4.0
"""Minimum look-ahead distance of the pure pursuit that gives the first guess [m]."""


@kernel
def is_tight(reference: Floats, curvature: float, sharpest: float) -> bool:
    """Return whether the lane ahead is too tight for a vehicle, or its steering is far from the lane's.

    Args:
        reference: Reference along the lane, shape (R, 4).
        curvature: Current curvature of the rear axle's path [1/m].
        sharpest: Maximum curvature of the vehicle [1/m].
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
    map_id: int,
    reference: Floats,
    pose: tuple[float, float, float],
    height: float,
    curvature: float,
    speed: float,
    kind: int,
    abilities: Abilities,
) -> None:
    """Replace the first points of a reference by a drivable path, and lower their speeds.

    Args:
        roads: The maps' lanes.
        map_id: The map.
        reference: Reference along the lane, written, shape (R, 4).
        pose: x, y [m] of the vehicle's centre and its heading [rad].
        height: Height of the road [m].
        curvature: Current curvature of the rear axle's path [1/m].
        speed: Speed of the vehicle [m/s].
        kind: The vehicle's `VehicleKind`.
        abilities: Limits of each kind of vehicle.
    """
    sharpest, wheelbase = RESERVED * abilities.sharpest[kind], abilities.wheelbase[kind]
    ahead = abilities.centre_to_rear[kind]
    rear = pose[0] - ahead * math.cos(pose[2]), pose[1] - ahead * math.sin(pose[2]), pose[2]
    count = min(int(RADII / (sharpest * STEP)), MOST_POINTS, len(reference) - 2)
    bends = np.empty(count)
    smoothness = np.empty(count)
    path = np.empty((count + 1, 3))
    found = np.empty((count + 1, 4))
    room = np.full((len(reference), 2), -1.0)
    for i in range(count):
        pace = min(reference[i, 3], math.sqrt(speed * speed + 2.0 * GAIN * STEP * i))
        smoothness[i] = SMOOTHNESS * wheelbase**2 * (1.0 + SMOOTHNESS_PER_SPEED * pace * pace)
    _pursue(reference, rear, curvature, sharpest, max(_PURSUED, wheelbase), bends)
    for _ in range(ITERATIONS):
        _drive(rear, ahead, bends, path)
        _measure(reference, path, found)
        _find_edges(roads, map_id, reference, height, room, found)
        _improve(bends, curvature, sharpest, ahead, smoothness, found)
    _drive(rear, ahead, bends, path)
    last = _measure(reference, path, found)
    _replace(reference, path, bends, curvature, abilities.agility[kind], ahead, last)


@kernel
def _pursue(
    reference: Floats,
    pose: tuple[float, float, float],
    curvature: float,
    sharpest: float,
    look_ahead: float,
    bends: Floats,
) -> None:
    """Write the curvatures of a vehicle that pursues a point ahead (pure pursuit), as a first guess."""
    x, y, heading = pose
    bend, goal = curvature, 0
    for i in range(len(bends)):
        while goal < len(reference) - 1:
            dx, dy = reference[goal, 0] - x, reference[goal, 1] - y
            if dx * dx + dy * dy >= look_ahead**2 and dx * math.cos(heading) + dy * math.sin(heading) > 0.0:
                break
            goal += 1
        dx, dy = reference[goal, 0] - x, reference[goal, 1] - y
        turn = wrapped(math.atan2(dy, dx) - heading)
        target = 2.0 * math.sin(turn) / max(math.hypot(dx, dy), 1.0)
        target = min(max(target, -sharpest), sharpest)
        bend += min(max(target - bend, -0.5 * sharpest), 0.5 * sharpest)
        bends[i] = bend
        middle = heading + 0.5 * STEP * bend
        x, y = x + STEP * math.cos(middle), y + STEP * math.sin(middle)
        heading += STEP * bend


@kernel
def _drive(rear: tuple[float, float, float], ahead: float, bends: Floats, path: Floats) -> None:
    """Write x, y of the centre and the heading along a plan's curvatures, shape (N + 1, 3)."""
    x, y, heading = rear
    for i in range(len(path)):
        path[i, 0], path[i, 1] = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
        path[i, 2] = heading
        if i < len(bends):
            middle = heading + 0.5 * STEP * bends[i]
            x, y = x + STEP * math.cos(middle), y + STEP * math.sin(middle)
            heading += STEP * bends[i]


@kernel
def _measure(reference: Floats, path: Floats, found: Floats) -> int:
    """Write the position of a plan's points beside a reference, shape (N + 1, 4); return the last segment.

    Columns: offset [m], relative heading [rad], excess over the room (by `_find_edges`) [m], segment.
    """
    segment = 0
    for i in range(len(path)):
        best, best_square, best_cross = segment, np.inf, 0.0
        for point in range(segment, min(segment + MOST_PASSED, len(reference) - 1)):
            a, b = reference[point], reference[point + 1]
            _, square, cross = project(path[i, 0], path[i, 1], a[0], a[1], b[0], b[1])
            if square < best_square:
                best, best_square, best_cross = point, square, cross
        segment = best
        found[i, 0] = math.copysign(math.sqrt(best_square), best_cross)
        found[i, 1] = wrapped(path[i, 2] - reference[segment, 2])
        found[i, 3] = segment
    return segment


@kernel
def _find_edges(
    roads: Roads, map_id: int, reference: Floats, height: float, room: Floats, found: Floats
) -> None:
    """Write by how much the offsets of a plan's points exceed the room beside the lane, else 0 [m].

    Args:
        roads: The maps' lanes.
        map_id: The map.
        reference: Reference along the lane, shape (R, 4).
        height: Height of the road [m].
        room: Room to the right and left of its points [m], shape (R, 2), -1 if unknown; written.
        found: See `_measure`; column 2 is written.
    """
    for i in range(len(found)):
        found[i, 2] = 0.0
        offset, point = found[i, 0], int(found[i, 3])
        if abs(offset) < LEAST_ROOM:
            continue
        side = 1 if offset > 0.0 else 0
        if room[point, side] < 0.0:
            room[point, side] = _room_beside(
                roads, map_id, reference[point], height, math.copysign(1.0, offset)
            )
        found[i, 2] = math.copysign(max(abs(offset) - room[point, side], 0.0), offset)


@kernel
def _room_beside(roads: Roads, map_id: int, point: Floats, height: float, side: float) -> float:
    """Return how far a vehicle's centre may be from a lane's centreline on a side (1 left, -1 right) [m]."""
    room, aside = LEAST_ROOM, LEAST_ROOM + EDGE_MARGIN + ROOM_STEP
    while room < MOST_ROOM:
        x = point[0] - side * aside * math.sin(point[2])
        y = point[1] + side * aside * math.cos(point[2])
        if not is_on_road(roads, map_id, x, y, height, _ROAD, True):
            break
        room += ROOM_STEP
        aside += ROOM_STEP
    return room


@kernel
def _improve(
    bends: Floats, curvature: float, sharpest: float, ahead: float, smoothness: Floats, found: Floats
) -> None:
    """Improve curvatures by one Gauss-Newton iteration from the offsets of the current plan.

    The state of the linearised problem is the change of the rear axle's offset, of its heading and of the
    curvature. The cost of a state x is x'Vx + 2v'x; V and v are computed backwards from the end.
    """
    count = len(bends)
    feedback = np.empty((count, 4))
    value, linear = np.zeros((3, 3)), np.zeros(3)
    value[1, 1], linear[1] = END_COST, END_COST * found[count, 1]
    for k in range(count - 1, -1, -1):
        _add_offset_cost(found[k + 1], END_COST if k == count - 1 else 1.0, ahead, value, linear)
        excess = abs(bends[k]) - sharpest
        if excess > 0.0:
            cost = BOUND_COST / (sharpest * sharpest)
            value[2, 2] += cost
            linear[2] += math.copysign(cost * excess, bends[k])
        change = bends[k] - (bends[k - 1] if k > 0 else curvature)
        _step_back(smoothness[k] / STEP, change, value, linear, feedback[k])
    aside, turn, bend = 0.0, 0.0, 0.0
    for k in range(count):
        row = feedback[k]
        bend += row[0] * aside + row[1] * turn + row[2] * bend + row[3]
        aside += STEP * turn
        turn += STEP * bend
        bends[k] += bend


@kernel
def _add_offset_cost(found: Floats, weight: float, ahead: float, value: Floats, linear: Floats) -> None:
    """Add the cost of the centre's offset at one point; see `_measure` and `_improve`."""
    offset = found[0]
    slope = weight * offset
    far = abs(offset) - EASY_OFFSET
    if far > 0.0:
        weight += FAR_COST
        slope += math.copysign(FAR_COST * far, offset)
    if found[2] != 0.0:
        weight += EDGE_COST
        slope += EDGE_COST * found[2]
    # The centre's offset is the rear axle's offset plus the heading times the distance between them.
    value[0, 0] += weight * STEP
    value[0, 1] += weight * STEP * ahead
    value[1, 0] += weight * STEP * ahead
    value[1, 1] += weight * STEP * ahead * ahead
    linear[0] += slope * STEP
    linear[1] += slope * STEP * ahead


@kernel
def _step_back(smoothness: float, change: float, value: Floats, linear: Floats, feedback: Floats) -> None:
    """Compute the cost before a step from the cost after it, and write the feedback of the optimal change.

    A state (offset, heading, curvature) leads to (offset + h heading, heading + h curvature, curvature),
    where the curvature is the changed one and h is `STEP`.
    """
    # Numbers: arrays here would be made two hundred times a plan.
    aside, turn, bend = value[1, 0], value[1, 1], value[1, 2]
    aside, turn, bend = aside * STEP + value[2, 0], turn * STEP + value[2, 1], bend * STEP + value[2, 2]
    gains = aside, aside * STEP + turn, turn * STEP + bend
    curving = smoothness + gains[2]
    slope = smoothness * change + linear[1] * STEP + linear[2]
    for j in range(3):
        value[j, 2] += STEP * value[j, 1]
        value[j, 1] += STEP * value[j, 0]
    for j in range(3):
        value[2, j] += STEP * value[1, j]
        value[1, j] += STEP * value[0, j]
    linear[2] += STEP * linear[1]
    linear[1] += STEP * linear[0]
    for i in range(3):
        feedback[i] = -gains[i] / curving
        linear[i] += feedback[i] * slope
        for j in range(3):
            value[i, j] += feedback[i] * gains[j]
    feedback[3] = -slope / curving


@kernel
def _replace(
    reference: Floats, path: Floats, bends: Floats, curvature: float, agility: float, ahead: float, last: int
) -> None:
    """Write a plan over the first points of a reference; the rest of the reference follows.

    Args:
        reference: The reference, written, shape (R, 4).
        path: Points of the plan, shape (N + 1, 3).
        bends: Curvatures of the plan [1/m], shape (N,).
        curvature: Curvature before the plan [1/m].
        agility: Maximum rate of change of the vehicle's curvature [1/(m s)].
        ahead: Distance from the rear axle to the centre [m].
        last: Segment of the reference beside the plan's end.
    """
    count = len(bends)
    rest = reference[last + 1 :].copy()
    for i in range(count + 1):
        bend = bends[i - 1] if i > 0 else curvature
        reference[i, 0], reference[i, 1] = path[i, 0], path[i, 1]
        reference[i, 2] = wrapped(path[i, 2] + math.atan(ahead * bend))
        change = abs(bends[min(i, count - 1)] - bend) / STEP
        reference[i, 3] = min(reference[i, 3], max(agility / max(change, 1e-6), CRAWL))
    end = reference[len(reference) - 1].copy()
    for i in range(count + 1, len(reference)):
        source = i - count - 1
        reference[i] = rest[source] if source < len(rest) else end
