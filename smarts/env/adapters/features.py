"""The numbers that an agent of the benchmark sees of one instant, for many agents at once.

Relative positions and velocities are compressed (`compressed`): a goal one lane aside is 3 m in 200 m, a
neighbour in the next lane 3 m in 50 m, and on a linear scale learners take long to notice either.

Axis letters: B simulations, G agents of the adapter, A agents, V vehicle slots.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, find_row, lane_length

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bytes = NDArray[np.int8]
Bools = NDArray[np.bool_]

WAYPOINTS = 20
NEIGHBOURS = 8
NEIGHBOUR_VALUES = 5
GOAL, LANE_OFFSET, SPEED, STEERING, HEADINGS = 0, 2, 3, 4, 5
NEIGHBOURHOOD = HEADINGS + WAYPOINTS
FEATURES = NEIGHBOURHOOD + NEIGHBOURS * NEIGHBOUR_VALUES
"""F, the numbers of one instant; the constants above say where each kind of them begins."""


GOAL_SCALE = 200.0
"""The largest distance to the goal ahead and aside [m]."""
SPEED_SCALE = 30.0
"""The largest speed, and velocity relative to a neighbour [m/s]."""
STEERING_SCALE = 0.6
"""[rad]"""
RADIUS = 50.0
"""Within which neighbours are seen [m]."""
SPACING = 1.0
"""Between waypoints [m]."""


@kernel
def clipped(value: float) -> float:
    """Return a number cut at -1 and 1."""
    return min(1.0, max(-1.0, value))


@kernel
def compressed(value: float, largest: float) -> float:
    """Return a length or speed on a logarithmic scale, 1 for `largest` and more.

    That is sign(x) ln(1 + |x|), the symlog of Hafner et al. 2023, "Mastering Diverse Domains through World
    Models", eq. 9, divided by its largest value; `expanded` takes it back.
    """
    return math.copysign(math.log1p(min(abs(value), largest)) / math.log1p(largest), value)


def expanded(feature: NDArray, largest: float) -> NDArray[np.float64]:
    """Return the lengths or speeds that `compressed` made these features of."""
    feature = np.asarray(feature, np.float64)
    return np.sign(feature) * np.expm1(np.abs(feature) * math.log1p(largest))


@kernel
def _heading_errors(
    roads: Roads, table: RouteTable, row: int, s: float, heading: float, out: Singles
) -> None:
    """Write the sine of how far each waypoint's direction is to the left of the heading.

    Waypoint i is i + 1 spacings ahead of arc length `s` of the lane of `row`, along the route. Behind the end
    of the route the last direction goes on.
    """
    error = 0.0
    s += SPACING
    lane = table.lane[row]
    point, last = roads.point_start[lane], roads.point_start[lane + 1] - 2
    for i in range(WAYPOINTS):
        while s > lane_length(roads, lane) and table.onward_start[row + 1] > table.onward_start[row]:
            s -= lane_length(roads, lane)
            row = int(table.onward[table.onward_start[row]])
            lane = table.lane[row]
            point, last = roads.point_start[lane], roads.point_start[lane + 1] - 2
        if s <= lane_length(roads, lane):
            while point < last and roads.point_s[point + 1] <= s:
                point += 1
            error = math.sin(centre_at(roads, point, s)[2] - heading)
        out[i] = error
        s += SPACING


@kernel
def path_ahead(
    roads: Roads, table: RouteTable, base: int, free: int, route: int, lane: int, done: float
) -> int:
    """Return the table's row of a lane on the route, or, off the route, in the corridor without one."""
    row = -1
    if route >= 0:
        row = find_row(table, table.free + route, base + lane, done)
    return row if row >= 0 else table.start[free] + lane


@kernel
def _neighbours(
    alive: Bools,
    position: Floats,
    heading: Floats,
    speed: Floats,
    lateral_speed: Floats,
    own: int,
    order: Ints,
    squares: Floats,
    out: Singles,
) -> None:
    """Write the nearest vehicles within the radius, nearest first, as seen from the vehicle in slot `own`.

    Of each: 1 - distance / radius; compressed: position ahead and to the left, velocity relative to one's own
    ahead and to the left. Of equally near ones the lower slot comes first.
    """
    x, y = position[own, 0], position[own, 1]
    count = 0
    for slot in range(len(alive)):
        if not alive[slot] or slot == own:
            continue
        square = (position[slot, 0] - x) ** 2 + (position[slot, 1] - y) ** 2
        if square >= RADIUS * RADIUS or (count == NEIGHBOURS and square >= squares[count - 1]):
            continue
        place = count if count < NEIGHBOURS else count - 1
        while place > 0 and squares[place - 1] > square:
            order[place], squares[place] = order[place - 1], squares[place - 1]
            place -= 1
        order[place], squares[place] = slot, square
        count = min(count + 1, NEIGHBOURS)
    cos, sin = math.cos(heading[own]), math.sin(heading[own])
    own_vx = speed[own] * cos - lateral_speed[own] * sin
    own_vy = speed[own] * sin + lateral_speed[own] * cos
    out[:] = 0.0
    for place in range(count):
        slot, first = order[place], place * NEIGHBOUR_VALUES
        dx, dy = position[slot, 0] - x, position[slot, 1] - y
        c, s = math.cos(heading[slot]), math.sin(heading[slot])
        vx = speed[slot] * c - lateral_speed[slot] * s - own_vx
        vy = speed[slot] * s + lateral_speed[slot] * c - own_vy
        out[first] = 1.0 - math.sqrt(squares[place]) / RADIUS
        out[first + 1] = compressed(dx * cos + dy * sin, RADIUS)
        out[first + 2] = compressed(dy * cos - dx * sin, RADIUS)
        out[first + 3] = compressed(vx * cos + vy * sin, SPEED_SCALE)
        out[first + 4] = compressed(vy * cos - vx * sin, SPEED_SCALE)


class Driving(NamedTuple):
    """Columns of `VehicleStates`, shape (B, V)."""

    alive: Bools
    position: Floats
    heading: Floats
    speed: Floats
    lateral_speed: Floats
    lane: Ints
    lane_position: Floats
    lane_offset: Floats


class EgoColumns(NamedTuple):
    """Columns of `AgentStates`, shape (B, A)."""

    slot: Ints
    target_lane: Ints
    route_progress: Floats
    steering: Floats
    lane_changes: Bytes
    last_moved_step: Ints


class Missions(NamedTuple):
    """Columns of the agents' missions, shape (B, A)."""

    goal: Bytes
    goal_position: Floats


@kernel
def _write_goal(
    missions: Missions, driving: Driving, b: int, agent_id: int, own: int, features: Singles
) -> None:
    features[GOAL : GOAL + 2] = 0.0
    if missions.goal[b, agent_id] != 0:
        cos, sin = math.cos(driving.heading[b, own]), math.sin(driving.heading[b, own])
        dx = missions.goal_position[b, agent_id, 0] - driving.position[b, own, 0]
        dy = missions.goal_position[b, agent_id, 1] - driving.position[b, own, 1]
        features[GOAL] = compressed(dx * cos + dy * sin, GOAL_SCALE)
        features[GOAL + 1] = compressed(dy * cos - dx * sin, GOAL_SCALE)


@kernel
def _write_lane(
    roads: Roads,
    table: RouteTable,
    map_number: int,
    route: int,
    egos_now: EgoColumns,
    driving: Driving,
    b: int,
    agent_id: int,
    features: Singles,
) -> None:
    """Write where the vehicle is in its lane, and how the lane that it steers for goes on."""
    own, base = egos_now.slot[b, agent_id], roads.lane_base[map_number]
    headings = features[HEADINGS:NEIGHBOURHOOD]
    features[LANE_OFFSET], headings[:] = 0.0, 0.0
    lane = driving.lane[b, own]
    if lane < 0:
        return
    features[LANE_OFFSET] = clipped(driving.lane_offset[b, own] / roads.lane_width[base + lane])
    s, done = driving.lane_position[b, own], egos_now.route_progress[b, agent_id]
    row = path_ahead(roads, table, base, map_number, route, lane, done)
    target = egos_now.target_lane[b, agent_id]
    if target >= 0 and target != lane:
        other = path_ahead(roads, table, base, map_number, route, target, done)
        # Only beside one's own: a target on another road is one that was passed.
        if table.group[other] == table.group[row]:
            own_end = lane_length(roads, base + lane)
            target_end = lane_length(roads, base + target)
            row, s = other, s * target_end / own_end
    _heading_errors(roads, table, row, s, driving.heading[b, own], headings)


@kernel
def write_features(
    roads: Roads,
    table: RouteTable,
    maps: Ints,
    routes: Ints,
    agent_ids: Ints,
    egos_now: EgoColumns,
    missions: Missions,
    driving: Driving,
    out: Singles,
    chosen: Bools,
) -> None:
    """Write the features of the chosen agents, each in [-1, 1].

    Args:
        roads: The maps' lanes.
        table: The routes.
        maps: Map of each simulation, shape (B,).
        routes: Number of each agent's route in the table, shape (B, A).
        agent_ids: The adapter's agents, shape (G,).
        egos_now: Of all agents.
        missions: Of all agents.
        driving: All vehicles.
        out: Written, shape (B, G, F).
        chosen: Whom to write, shape (B, G); each holds a vehicle that is alive.
    """
    order, squares = np.empty(NEIGHBOURS, np.int32), np.empty(NEIGHBOURS)
    for b in range(len(maps)):
        for g in range(len(agent_ids)):
            if not chosen[b, g]:
                continue
            agent_id, features = agent_ids[g], out[b, g]
            own = egos_now.slot[b, agent_id]
            _write_goal(missions, driving, b, agent_id, own, features)
            features[SPEED] = clipped(driving.speed[b, own] / SPEED_SCALE)
            features[STEERING] = clipped(egos_now.steering[b, agent_id] / STEERING_SCALE)
            _write_lane(roads, table, maps[b], routes[b, agent_id], egos_now, driving, b, agent_id, features)
            _neighbours(
                driving.alive[b],
                driving.position[b],
                driving.heading[b],
                driving.speed[b],
                driving.lateral_speed[b],
                own,
                order,
                squares,
                features[NEIGHBOURHOOD:FEATURES],
            )


@kernel
def write_stack(features: Singles, is_new: Bools, frames: int, vectors: Singles, chosen: Bools) -> None:
    """Append the chosen agents' features to the frames they hold, the oldest of which goes.

    Args:
        features: Shape (B, G, F).
        is_new: Who holds no frames yet and gets as many of this one; cleared for the chosen, shape (B, G).
        frames: How many a vector holds, the oldest first.
        vectors: Written, from their beginning, shape (B, G, at least frames * F).
        chosen: Whom to write, shape (B, G).
    """
    size = features.shape[2]
    for b in range(features.shape[0]):
        for g in range(features.shape[1]):
            if not chosen[b, g]:
                continue
            vector = vectors[b, g]
            for frame in range(frames - 1):
                begin = frame * size
                for i in range(size):
                    kept = features[b, g, i] if is_new[b, g] else vector[begin + size + i]
                    vector[begin + i] = kept
            for i in range(size):
                vector[(frames - 1) * size + i] = features[b, g, i]
            is_new[b, g] = False
