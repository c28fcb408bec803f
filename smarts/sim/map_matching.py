"""Map matching: each vehicle's lane, and each agent's progress along its route."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.footprints import count_corners_on_road, is_on_road
from smarts.roads.kernels import candidates, centre_at, distance_on_row, find_row, lane_length, place_on_map
from smarts.roads.scene import Scene
from smarts.sim.places import lane_of, line_on
from smarts.types.mission import GoalKind
from smarts.types.vehicles import STANDING, VehicleStates
from smarts.types.world import State

FARTHEST_STEP = 10.0
"""How far a vehicle may come in one step: at 100 m/s in 0.1 s [m]."""
_ROAD = sum(1 << kind for kind in ROAD_LANES)
_LAPS = int(GoalKind.LAPS)
_LATEST = 1e12
"""Beyond the end of every route [m]: picks the last time that a route uses a lane."""


class MapMatcher:
    """Finds all vehicles' lanes, and the agents' progress along their routes."""

    def __init__(self, scene: Scene) -> None:
        world, roads = scene.world, scene.atlas.roads
        self.match: Callable[[Bools], None] = bind(
            match_vehicles, world.state, roads, scene.routes.current, world.placed
        )
        """See `match_vehicles`; takes `env_mask`."""


@kernel
def match_vehicles(state: State, roads: Roads, routes: RouteTable, placed: Bools, env_mask: Bools) -> None:
    """Write the places of vehicles that are not `placed`, since when all stand, and agents' places on routes.

    On its route, an agent's `remaining` is the distance to the goal, on the last lap of several, and 0
    behind it, and `lane_changes` are those that the goal's lane demands; off the route, as off the road,
    both stay as they were. Without a route an agent counts as on its route, and its `route_progress` is
    what it has driven along the lanes.
    """
    vehicles, agents = state.vehicles, state.agents
    room, corridor = candidates(), np.empty(vehicles.alive.shape[1], np.int32)
    for b in np.flatnonzero(env_mask):
        # The corridor of the route that each vehicle's agent is on, -1 without one.
        corridor[: state.used[b]] = -1
        for a in range(agents.slot.shape[1]):
            if agents.slot[b, a] >= 0 and routes.number[b, a] >= 0:
                corridor[agents.slot[b, a]] = routes.free + routes.number[b, a]
        for v in range(state.used[b]):
            is_placed, placed[b, v] = placed[b, v], False
            if vehicles.alive[b, v]:
                if not is_placed:
                    _place(state, roads, routes, b, v, corridor[v], room)
                _note_standing(state, b, v)
        for a in range(agents.slot.shape[1]):
            if agents.slot[b, a] >= 0:
                _place_agent(state, roads, routes, corridor[agents.slot[b, a]], b, a)


@kernel
def _place_agent(state: State, roads: Roads, routes: RouteTable, corridor: int, b: int, a: int) -> None:
    """Write how an agent stands to the road and to its route, of the number `corridor`, and its progress."""
    vehicles, agents = state.vehicles, state.agents
    v, world = agents.slot[b, a], state.map[b]
    x, y, heading = vehicles.position[b, v, 0], vehicles.position[b, v, 1], vehicles.heading[b, v]
    length, width, height = vehicles.length[b, v], vehicles.width[b, v], vehicles.height[b, v]
    is_new = agents.entry_step[b, a] == state.step[b]
    came_by_road = not (agents.left_road[b, a] or is_new)
    lane = lane_of(state, roads, vehicles, b, v)
    agents.on_road[b, a] = is_on_road(roads, world, x, y, height, _ROAD, True, lane)
    agents.corners_on_road[b, a] = count_corners_on_road(
        roads, world, x, y, height, heading, length, width, _ROAD, True, lane
    )
    agents.on_route[b, a] = corridor < 0
    agents.left_road[b, a] = not (agents.on_road[b, a] and (came_by_road or is_new))
    if not agents.on_road[b, a] and not is_new:
        return
    if corridor >= 0:
        _measure(state, roads, routes, corridor, b, a, is_new, came_by_road)
    else:
        if came_by_road:
            agents.route_progress[b, a] += _way_along_lane(state, roads, b, v)
        agents.left_road[b, a] = not agents.on_road[b, a]


@kernel
def _place(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    slot: int,
    corridor: int,
    room: tuple[Ints, Ints, Floats],
) -> None:
    """Write a vehicle's place."""
    vehicles = state.vehicles
    x, y, heading = vehicles.position[b, slot, 0], vehicles.position[b, slot, 1], vehicles.heading[b, slot]
    height = vehicles.height[b, slot]
    place = place_on_map(roads, routes, state.map[b], x, y, height, heading, corridor, _ROAD, room)
    vehicles.lane[b, slot] = place[0]
    vehicles.lane_position[b, slot] = place[1]
    vehicles.lane_offset[b, slot] = place[2]
    vehicles.height[b, slot] = place[4]


@kernel
def _note_standing(state: State, b: int, slot: int) -> None:
    """Write since when a vehicle stands."""
    vehicles = state.vehicles
    if abs(vehicles.speed[b, slot]) >= STANDING:
        vehicles.standing_since[b, slot] = -1
    elif vehicles.standing_since[b, slot] < 0:
        vehicles.standing_since[b, slot] = state.step[b]


@kernel
def _way_along_lane(state: State, roads: Roads, b: int, slot: int) -> float:
    """Return how far a vehicle on the road came along its lane in this step [m], < 0 against it."""
    lane = lane_of(state, roads, state.vehicles, b, slot)
    if lane < 0:
        return 0.0
    s = state.vehicles.lane_position[b, slot]
    point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
    _, _, heading = centre_at(roads, point, s)
    way = state.vehicles.position[b, slot] - state.before.position[b, slot]
    return way[0] * math.cos(heading) + way[1] * math.sin(heading)


@kernel
def _measure(
    state: State,
    roads: Roads,
    routes: RouteTable,
    corridor: int,
    b: int,
    a: int,
    is_new: bool,
    came_by_road: bool,
) -> None:
    """Write how far an agent on the road, or one that enters beside it, has come on its route."""
    vehicles, agents, missions = state.vehicles, state.agents, state.missions
    v, base = agents.slot[b, a], roads.lane_base[state.map[b]]
    before = agents.route_progress[b, a]
    row = -1
    if vehicles.lane[b, v] >= 0:
        row = find_row(routes, corridor, base + vehicles.lane[b, v], before)
    agents.on_route[b, a] = row >= 0 and agents.on_road[b, a]
    if row < 0:
        return
    done = distance_on_row(roads, routes, row, vehicles.lane_position[b, v])
    goal = routes.end[routes.start[corridor + 1] - 1]
    if missions.goal_lane[b, a] >= 0:
        lane = base + missions.goal_lane[b, a]
        last = find_row(routes, corridor, lane, _LATEST)
        if last >= 0:
            goal = distance_on_row(roads, routes, last, missions.goal_s[b, a])
            from_end = routes.start[corridor + 1] - 1 - last
            agents.lane_changes[b, a] = (
                routes.changes[row, from_end] if from_end < routes.changes.shape[1] else 0
            )
        if missions.goal[b, a] == _LAPS and last >= 0 and came_by_road:
            passed = find_row(routes, corridor, lane, done)
            was = before - _line_for(state, roads, routes, passed, state.before, b, a)
            now = done - _line_for(state, roads, routes, passed, vehicles, b, a)
            # Each line counts once, also for a vehicle that goes back and forth.
            if was < 0.0 <= now and agents.lap[b, a] < _laps_until(state, routes, passed, last, b, a):
                agents.lap[b, a] += 1
    if came_by_road and goal - before <= FARTHEST_STEP and before - done > FARTHEST_STEP:
        # Over the route's end, and round to its begin.
        done = goal
    left = max(0.0, goal - done)
    if not came_by_road and not is_new:
        agents.skipped[b, a] += max(0.0, agents.remaining[b, a] - left)
    agents.route_progress[b, a] = done
    agents.remaining[b, a] = left
    agents.left_road[b, a] = not agents.on_road[b, a]


@kernel
def _line_for(
    state: State, roads: Roads, routes: RouteTable, row: int, vehicles: VehicleStates, b: int, a: int
) -> float:
    """Return where on its route the goal line of a row crosses the lane that an agent is in, or was [m]."""
    lane, slot = routes.lane[row], state.agents.slot[b, a]
    goal_lane, goal_s = lane, state.missions.goal_s[b, a]
    own = lane_of(state, roads, vehicles, b, slot)
    if own >= 0 and roads.lane_edge[own] == roads.lane_edge[goal_lane]:
        lane = own
    share = line_on(roads, goal_lane, goal_s, lane) / lane_length(roads, lane)
    return routes.begin[row] + min(1.0, max(0.0, share)) * (routes.end[row] - routes.begin[row])


@kernel
def _laps_until(state: State, routes: RouteTable, row: int, last: int, b: int, a: int) -> int:
    """Return how many laps are complete at the goal line of a row; `last` is the row of the last one."""
    left = 0
    for later in range(row + 1, last + 1):
        left += routes.lane[later] == routes.lane[last]
    return int(state.missions.laps[b, a] - left)
