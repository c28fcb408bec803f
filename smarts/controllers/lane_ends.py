"""Merges before the end of a lane, and stops before that of a road; used by the controllers of lanes."""

from __future__ import annotations

import math

from smarts.arrays import Floats
from smarts.controllers.lane_changes import beside, is_drivable
from smarts.controllers.leaders import BRAKING, brake_to
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.roads.lane_ways import next_row, place_on_lane, row_of
from smarts.roads.levels import meets
from smarts.types.agent_states import ChangePhase
from smarts.types.mission import GoalKind
from smarts.types.world import State

MERGE_ROOM = 20.0
MERGE_TIME = 4.0
"""A vehicle begins to merge when its front is 20 m plus 4 s of travel before the end of its lane."""
WAIT_ROOM = 15.0
"""Room in which a vehicle that waits for a gap can still merge [m]."""
STOP_GAP = 2.0
"""Gap to the end of a lane that no other leads on from [m]."""
SPARE_GAP = 2.0
SPARE_TIME = 2.0
"""Gap to the vehicles in the lane to merge into: 2 m, and what is lost in 2 s by the difference of speeds."""

_NONE, _REQUESTED = int(ChangePhase.NONE), int(ChangePhase.REQUESTED)
_ENDLESS, _OFF_MAP = int(GoalKind.ENDLESS), int(GoalKind.OFF_MAP)


@kernel
def merge_before_end(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    a: int,
    row: int,
    s: float,
    t: float,
    change: int,
    may_leave: bool,
) -> tuple[int, float, float, float, int]:
    """Let an agent whose lane ends soon, and that has given no lane change, merge if there is a gap.

    Args:
        state: The state of the world; the agent's lane-change state is written.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: The simulation.
        a: The agent.
        row: The row of its target lane.
        s: Position of its vehicle on that lane [m].
        t: Offset of its vehicle from that lane [m].
        change: Its lane-change command, 0 for none.
        may_leave: Whether it may drive off the end.

    Returns:
        row, s, t as `latch` has them, then distance of the front to the end [m] and row of the lane that
        ends, as `_find_end` has them.
    """
    if may_leave:
        return row, s, t, math.inf, -1
    room, end = _find_end(state, roads, routes, b, a, row, s)
    if end == row and change == 0:
        row, s, t = _merge(state, roads, routes, b, a, row, s, t, room)
        room, end = _find_end(state, roads, routes, b, a, row, s)
    return row, s, t, room, end


@kernel
def _find_end(
    state: State, roads: Roads, routes: RouteTable, b: int, a: int, row: int, s: float
) -> tuple[float, int]:
    """Return how far ahead of an agent's front its lane ends [m], and the row of the lane that ends.

    The distance is infinite, and the row -1, if there is no end within the distance in which the vehicle
    merges or stops, or if it is to drive to the end: on the last road of its route, and at the end of a road
    if leaving the map ends its mission.
    """
    m, slot = state.map[b], state.agents.slot[b, a]
    speed = max(state.vehicles.speed[b, slot], 0.0)
    sight = MERGE_ROOM + max(MERGE_TIME * speed, speed * speed / (2.0 * BRAKING))
    room = lane_length(roads, routes.lane[row]) - s - 0.5 * state.vehicles.length[b, slot]
    while room < sight:
        following = next_row(roads, routes, m, row, roads.lane_base[m])
        if following < 0:
            return (math.inf, -1) if _is_to_be_reached(state, roads, routes, b, a, row) else (room, row)
        row = following
        room += lane_length(roads, routes.lane[row])
    return math.inf, -1


@kernel
def _is_to_be_reached(state: State, roads: Roads, routes: RouteTable, b: int, a: int, row: int) -> bool:
    """Return whether an agent is to drive to the end of a row's lane, which leads nowhere."""
    route, lane = routes.number[b, a], int(routes.lane[row])
    if route >= 0:
        last = routes.start[routes.free + route + 1] - 1
        if roads.lane_edge[lane] == roads.lane_edge[routes.lane[last]]:
            return True
    leaves_map = state.missions.goal[b, a] in (_ENDLESS, _OFF_MAP)
    return leaves_map and _lane_to_merge(state, roads, routes, b, a, lane) < 0


@kernel
def _lane_to_merge(state: State, roads: Roads, routes: RouteTable, b: int, a: int, lane: int) -> int:
    """Return the lane beside `lane` on the way to the nearest one that leads on, -1 without one.

    A lane that leads on along the agent's route goes before one that leads elsewhere.
    """
    agents, m = state.agents, state.map[b]
    kind = state.vehicles.kind[b, agents.slot[b, a]]
    first_lane, route = roads.lane_base[m], routes.number[b, a]
    best, best_cost = -1, math.inf
    for change in (1, -1):
        other, count = beside(roads, lane, change), 1
        while other >= 0 and is_drivable(roads, other, kind):
            row = row_of(routes, m, route, other, first_lane, agents.route_progress[b, a])
            if next_row(roads, routes, m, row, first_lane) >= 0:
                is_off_route = route >= 0 and routes.onward_start[row] == routes.onward_start[row + 1]
                is_off_route |= route >= 0 and row < routes.start[routes.free]
                cost = count + (100.0 if is_off_route else 0.0)
                if cost < best_cost:
                    best, best_cost = beside(roads, lane, change), cost
                if not is_off_route:
                    break
            other, count = beside(roads, other, change), count + 1
    return best


@kernel
def _merge(
    state: State, roads: Roads, routes: RouteTable, b: int, a: int, row: int, s: float, t: float, room: float
) -> tuple[int, float, float]:
    """Begin to merge if the end of the agent's lane is near and there is a gap; return row, s, t."""
    agents, m = state.agents, state.map[b]
    slot = agents.slot[b, a]
    near = room < MERGE_ROOM + MERGE_TIME * max(state.vehicles.speed[b, slot], 0.0)
    if not near or agents.change_phase[b, a] != _NONE:
        return row, s, t
    other = _lane_to_merge(state, roads, routes, b, a, int(routes.lane[row]))
    if other < 0 or not _has_gap(state, roads, b, slot, other):
        return row, s, t
    agents.change_phase[b, a], agents.target_lane[b, a] = _REQUESTED, other - roads.lane_base[m]
    x, y = state.vehicles.position[b, slot, 0], state.vehicles.position[b, slot, 1]
    route, hint = routes.number[b, a], agents.route_progress[b, a]
    s, t = place_on_lane(roads, other, x, y, state.vehicles.height[b, slot])
    return row_of(routes, m, route, other, roads.lane_base[m], hint), s, t


@kernel
def _has_gap(state: State, roads: Roads, b: int, slot: int, lane: int) -> bool:
    """Return whether a vehicle has room between those in a lane and behind its begin."""
    vehicles = state.vehicles
    x, y = vehicles.position[b, slot, 0], vehicles.position[b, slot, 1]
    own, _ = place_on_lane(roads, lane, x, y, vehicles.height[b, slot])
    speed, width = vehicles.speed[b, slot], roads.lane_width[lane]
    for v in range(vehicles.alive.shape[1]):
        if not meets(vehicles, b, slot, v):
            continue
        x2, y2 = vehicles.position[b, v, 0], vehicles.position[b, v, 1]
        half = 0.5 * (vehicles.length[b, slot] + vehicles.length[b, v])
        closing = abs(speed - vehicles.speed[b, v])
        if math.hypot(x2 - x, y2 - y) > half + SPARE_GAP + SPARE_TIME * closing + width:
            continue
        place, offset = place_on_lane(roads, lane, x2, y2, vehicles.height[b, v])
        if abs(offset) > 0.5 * (width + vehicles.width[b, v]):
            continue
        ahead = place - own
        nearing = speed - vehicles.speed[b, v] if ahead > 0.0 else vehicles.speed[b, v] - speed
        if abs(ahead) - half < SPARE_GAP + SPARE_TIME * max(nearing, 0.0):
            return False
    return True


@kernel
def stop_before_end(
    state: State, roads: Roads, routes: RouteTable, b: int, a: int, row: int, room: float, points: Floats
) -> None:
    """Lower a reference's speeds so that the vehicle stops before the end of its lane, if there is one.

    Where it can merge, it stops early enough to have room for it.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: The simulation.
        a: The agent.
        row: The row of the lane that ends, -1 for none.
        room: Distance of the front to the end [m].
        points: The reference, shape (R, 4), see `Commands`; its speeds are lowered.
    """
    if row < 0:
        return
    can_merge = _lane_to_merge(state, roads, routes, b, a, int(routes.lane[row])) >= 0
    brake_to(points, room - (WAIT_ROOM if can_merge else STOP_GAP), 0.0)
