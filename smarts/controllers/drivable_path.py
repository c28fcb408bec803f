"""Kernels: the path nearest to a lane that a vehicle can drive, where the lane bends tighter than it can.

The plan is a path of the rear axle from where it is now: curvatures u(s) that minimise the integral of
(offset of the centre from the lane)^2 + smoothness (du/ds)^2, with |u| below what the lock allows. Offsets
cost more where they are large, and most near the edge of the road. So a vehicle swings wide before a turn
that is too tight, by about as much as it cuts inside, and further where the road is wider. Each iteration
drives the present curvatures exactly, measures the offsets, and solves the problem linearised about that way
by one Riccati recursion (Gauss-Newton; Li and Todorov, ICINCO 2004). A change of curvature costs more where
the vehicle is faster, since its steering's rate is bounded; the speed is lowered to what the change still
needs.
"""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats
from smarts.controllers.abilities import Abilities
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import project, wrapped
from smarts.roads.arrays import Roads
from smarts.roads.footprints import is_on_road
from smarts.roads.lane_graph import LaneKind

PLANNED = 1.0
"""`Commands.window` of a plan [m]."""
STEP = 1.0
"""Between the points of a plan [m]."""
RADII = 6.0
"""Length of a plan, in turning radii of the vehicle."""
MOST_POINTS = 46
"""Most points of a plan."""
LOOK_AHEAD = 30
"""Points ahead among which a bend is looked for that is too tight."""
TIGHT_SHARE = 0.93
"""A lane is tight where it bends more than this share of the vehicle's sharpest curvature."""
UNWOUND_SHARE = 0.3
"""The steering is off the lane's by more than this share of the sharpest curvature: it is still to unwind."""
MOST_PASSED = 3
"""Segments of the lane that one step of a plan may pass, so that it leaves no loop out."""
RESERVED = 0.92
"""Share of the sharpest curvature that plans use; the rest is for feedback."""
ITERATIONS = 6
SMOOTHNESS = 2.0
"""Cost of a change of the steering along the way, over squared wheelbases, at rest [m^2]."""
SMOOTHNESS_PER_SPEED = 1.0
"""Its growth with the square of the speed [s^2/m^2]."""
BOUND_COST = 200.0
"""Cost of the excess over the sharpest curvature, relative to it, squared."""
EASY_OFFSET = 0.6
FAR_COST = 10.0
"""Cost of the excess over `EASY_OFFSET` [m], squared, relative to that of offsets."""
EDGE_MARGIN = 0.5
"""Between a vehicle's centre and the edge of the road [m]."""
LEAST_ROOM, MOST_ROOM, ROOM_STEP = 0.8, 3.2, 0.4
"""Beside the middle of a lane, to that margin [m]."""
EDGE_COST = 100.0
"""Cost of the excess over the room [m], squared."""
END_COST = 5.0
"""Cost of offset and heading [m] at the plan's end, relative to that of a point."""
CRAWL = 1.2
"""The least speed to which a plan brakes [m/s]."""
GAIN = 1.5
"""Acceleration that a plan reckons with [m/s^2]."""
_ROAD = 1 << LaneKind.CAR | 1 << LaneKind.BUS
_PURSUED = 4.0
"""Look-ahead of the pursuit that gives the first guess [m]."""


@kernel
def is_tight(reference: Floats, curvature: float, sharpest: float) -> bool:
    """Return whether a lane ahead bends tighter than a vehicle can well drive, or its steering is far off it.

    Args:
        reference: Along the lane, shape (R, 4).
        curvature: Of its rear axle's path at present [1/m].
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
    kind: int,
    abilities: Abilities,
) -> None:
    """Replace the first points of a reference by what the vehicle can drive, and lower their speeds to that.

    Args:
        roads: The maps' lanes.
        world: Map number.
        reference: Along the lane, with its speeds, shape (R, 4); written.
        pose: x, y [m] of the vehicle's centre and its heading [rad].
        curvature: Of its rear axle's path [1/m].
        speed: [m/s]
        kind: A `VehicleKind`.
        abilities: Of all kinds.
    """
    sharpest, wheelbase = RESERVED * abilities.sharpest[kind], abilities.wheelbase[kind]
    ahead = abilities.centre_to_rear[kind]
    rear = pose[0] - ahead * math.cos(pose[2]), pose[1] - ahead * math.sin(pose[2]), pose[2]
    count = min(int(RADII / (sharpest * STEP)), MOST_POINTS, len(reference) - 2)
    bends = np.empty(count)
    smoothness = np.empty(count)
    way = np.empty((count + 1, 3))
    found = np.empty((count + 1, 4))
    room = np.full((len(reference), 2), -1.0)
    for i in range(count):
        pace = min(reference[i, 3], math.sqrt(speed * speed + 2.0 * GAIN * STEP * i))
        smoothness[i] = SMOOTHNESS * wheelbase**2 * (1.0 + SMOOTHNESS_PER_SPEED * pace * pace)
    _pursue(reference, rear, curvature, sharpest, max(_PURSUED, wheelbase), bends)
    for _ in range(ITERATIONS):
        _drive(rear, ahead, bends, way)
        _measure(reference, way, found)
        _find_edges(roads, world, reference, room, found)
        _improve(bends, curvature, sharpest, ahead, smoothness, found)
    _drive(rear, ahead, bends, way)
    last = _measure(reference, way, found)
    _replace(reference, way, bends, curvature, abilities.agility[kind], ahead, last)


@kernel
def _pursue(
    reference: Floats,
    pose: tuple[float, float, float],
    curvature: float,
    sharpest: float,
    look_ahead: float,
    bends: Floats,
) -> None:
    """Write the curvatures of a vehicle that steers for a point ahead: a first guess."""
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
        wanted = 2.0 * math.sin(turn) / max(math.hypot(dx, dy), 1.0)
        wanted = min(max(wanted, -sharpest), sharpest)
        bend += min(max(wanted - bend, -0.5 * sharpest), 0.5 * sharpest)
        bends[i] = bend
        middle = heading + 0.5 * STEP * bend
        x, y = x + STEP * math.cos(middle), y + STEP * math.sin(middle)
        heading += STEP * bend


@kernel
def _drive(rear: tuple[float, float, float], ahead: float, bends: Floats, way: Floats) -> None:
    """Write x, y of the centre and the heading on the way of some curvatures, shape (N + 1, 3)."""
    x, y, heading = rear
    for i in range(len(way)):
        way[i, 0], way[i, 1] = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
        way[i, 2] = heading
        if i < len(bends):
            middle = heading + 0.5 * STEP * bends[i]
            x, y = x + STEP * math.cos(middle), y + STEP * math.sin(middle)
            heading += STEP * bends[i]


@kernel
def _measure(reference: Floats, way: Floats, found: Floats) -> int:
    """Write where a way's points are beside a reference, shape (N + 1, 4); return the last one's segment.

    The columns are offset [m], relative heading [rad], what `_find_edges` writes, and the segment.
    """
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
        found[i, 3] = segment
    return segment


@kernel
def _find_edges(roads: Roads, world: int, reference: Floats, room: Floats, found: Floats) -> None:
    """Write how far a way's points are nearer to the edge of the road than they should be, else 0 [m].

    Args:
        roads: The maps' lanes.
        world: Map number.
        reference: Along the lane, shape (R, 4).
        room: To the right and left of its points [m], -1 where it has not been looked up; written.
        found: See `_measure`; written.
    """
    for i in range(len(found)):
        found[i, 2] = 0.0
        offset, point = found[i, 0], int(found[i, 3])
        if abs(offset) < LEAST_ROOM:
            continue
        side = 1 if offset > 0.0 else 0
        if room[point, side] < 0.0:
            room[point, side] = _room_beside(roads, world, reference[point], math.copysign(1.0, offset))
        found[i, 2] = math.copysign(max(abs(offset) - room[point, side], 0.0), offset)


@kernel
def _room_beside(roads: Roads, world: int, point: Floats, side: float) -> float:
    """Return how far from a lane's middle a vehicle's centre may be on a side (1 left, -1 right) [m]."""
    room, aside = LEAST_ROOM, LEAST_ROOM + EDGE_MARGIN + ROOM_STEP
    while room < MOST_ROOM:
        x = point[0] - side * aside * math.sin(point[2])
        y = point[1] + side * aside * math.cos(point[2])
        if not is_on_road(roads, world, x, y, _ROAD, True):
            break
        room += ROOM_STEP
        aside += ROOM_STEP
    return room


@kernel
def _improve(
    bends: Floats, curvature: float, sharpest: float, ahead: float, smoothness: Floats, found: Floats
) -> None:
    """Write better curvatures, from the offsets to which the present ones lead; see the module.

    The state of the linearised problem is by how much the rear axle's offset, its heading and the curvature
    differ from the present plan's. The cost of a state x is x'Vx + 2v'x; V and v are reckoned from the end.
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
        _go_back(smoothness[k] / STEP, change, value, linear, feedback[k])
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
    # The centre's offset is the rear axle's, and what the heading makes of the way between.
    value[0, 0] += weight * STEP
    value[0, 1] += weight * STEP * ahead
    value[1, 0] += weight * STEP * ahead
    value[1, 1] += weight * STEP * ahead * ahead
    linear[0] += slope * STEP
    linear[1] += slope * STEP * ahead


@kernel
def _go_back(smoothness: float, change: float, value: Floats, linear: Floats, feedback: Floats) -> None:
    """Turn the cost behind a step into the cost before it, and write the best change of curvature there.

    A state (offset, heading, curvature) leads to (offset + h heading, heading + h curvature, curvature),
    where the curvature is the changed one and h is `STEP`.
    """
    to_bend = value[1] * STEP + value[2]
    gains = np.empty(3)
    gains[0], gains[1] = to_bend[0], to_bend[0] * STEP + to_bend[1]
    gains[2] = to_bend[1] * STEP + to_bend[2]
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
    reference: Floats,
    way: Floats,
    bends: Floats,
    curvature: float,
    agility: float,
    ahead: float,
    last: int,
) -> None:
    """Write a plan over the first points of a reference; what is behind it follows.

    Args:
        reference: Written.
        way: Its points, shape (N + 1, 3).
        bends: Its curvatures, shape (N,).
        curvature: Before it.
        agility: How fast the vehicle can change its curvature [1/(m s)].
        ahead: From the rear axle to the centre [m].
        last: The segment of the reference beside its end.
    """
    count = len(bends)
    rest = reference[last + 1 :].copy()
    for i in range(count + 1):
        bend = bends[i - 1] if i > 0 else curvature
        reference[i, 0], reference[i, 1] = way[i, 0], way[i, 1]
        reference[i, 2] = wrapped(way[i, 2] + math.atan(ahead * bend))
        change = abs(bends[min(i, count - 1)] - bend) / STEP
        reference[i, 3] = min(reference[i, 3], max(agility / max(change, 1e-6), CRAWL))
    end = reference[len(reference) - 1].copy()
    for i in range(count + 1, len(reference)):
        source = i - count - 1
        reference[i] = rest[source] if source < len(rest) else end
