"""The rules of events; kernels for one agent."""

from __future__ import annotations

import math

import numpy as np

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import project, segment_at
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.footprints import is_on_road
from smarts.roads.kernels import centre_at, is_level, lane_length, nearest_segment
from smarts.roads.lane_ways import place_on_lane
from smarts.roads.levels import meets
from smarts.roads.lights import light_ahead
from smarts.sim.places import corridor_row, lane_of, line_on, was_there
from smarts.sim.yielding import yields_to_stream
from smarts.types.events import Event
from smarts.types.interface import AgentRules
from smarts.types.mission import GoalKind
from smarts.types.traffic import Signal
from smarts.types.vehicles import STANDING
from smarts.types.world import State

MISSED_BY = 5.0
"""How far behind the goal line, still on its road, the goal counts as missed [m]."""
QUEUE_GAP = 10.0
"""A standing vehicle this close ahead, bumper to bumper, is waited for [m]."""
QUEUE_AT_LIGHT = 40.0
"""This far before the end of a lane a red light is waited for [m]."""
OFF_ROUTE_TIME = 0.5
"""How long a vehicle may be off its route [s]; some corners are cut."""

_ROAD = sum(1 << kind for kind in ROAD_LANES)
_STOP = int(Signal.STOP)
_ENDLESS, _POSITION, _LANE_LINE, _LAPS, _OFF_MAP = (
    int(kind)
    for kind in (GoalKind.ENDLESS, GoalKind.POSITION, GoalKind.LANE_LINE, GoalKind.LAPS, GoalKind.OFF_MAP)
)
_OFF_ROAD, _OFF_ROUTE, _ON_SHOULDER = int(Event.OFF_ROAD), int(Event.OFF_ROUTE), int(Event.ON_SHOULDER)
_WRONG_WAY, _NOT_MOVING = int(Event.WRONG_WAY), int(Event.NOT_MOVING)
_REACHED, _MISSED = int(Event.REACHED_GOAL), int(Event.MISSED_GOAL)
_TIME_OUT = int(Event.REACHED_MAX_EPISODE_STEPS)
_VIA_HIT, _LAP_COMPLETED = int(Event.VIA_HIT), int(Event.LAP_COMPLETED)

AT_JOINT = 0.5
"""A vehicle that is on another road now, and was within this of its road's end, came over that end [m]."""
_AT_END = 0.01
"""Located within this of a lane's end, a vehicle has left it there [m]; places are clipped to the lane."""


@kernel
def judge(
    state: State, roads: Roads, routes: RouteTable, rules: AgentRules, patience: int, row: int, agent_id: int
) -> int:
    """Return one agent's events in this step, except those caused by other agents; write its memory.

    Args:
        state: The world.
        roads: The maps' lanes.
        routes: The agents' routes.
        rules: The agents' rules.
        patience: Steps off its route after which a vehicle counts as off-route.
        row: The simulation.
        agent_id: An agent with a vehicle.
    """
    has_left = _has_left_map(state, roads, row, agent_id)
    bits = _REACHED if has_left else _road_events(state, roads, routes, patience, row, agent_id)
    if state.agents.on_road[row, agent_id]:
        # Off the road the lane is only the nearest one, however far away.
        bits |= _goal_events(state, roads, routes, row, agent_id) | _via_events(state, roads, row, agent_id)
    if _rests(state, roads, routes, rules, row, agent_id):
        bits |= _NOT_MOVING
    limit = rules.max_steps[agent_id]
    if limit > 0 and state.step[row] - state.agents.entry_step[row, agent_id] >= limit:
        bits |= _TIME_OUT
    return bits


@kernel
def _way(state: State, row: int, slot: int) -> tuple[float, float, float, float]:
    """Return where a vehicle's centre was and is: x, y, x, y [m]."""
    now = state.vehicles.position[row, slot]
    is_known = was_there(state.vehicles, state.before, row, slot)
    before = state.before.position[row, slot] if is_known else now
    return before[0], before[1], now[0], now[1]


@kernel
def _passes(
    state: State, roads: Roads, row: int, slot: int, lane: int, x: float, y: float, radius: float
) -> bool:
    """Return whether a vehicle's centre has come within a radius of a point of a lane since a step ago."""
    begin_x, begin_y, end_x, end_y = _way(state, row, slot)
    if project(x, y, begin_x, begin_y, end_x, end_y)[1] > radius * radius:
        return False
    if lane < 0:
        return True
    number = roads.lane_base[state.map[row]] + lane
    first, last = roads.point_start[number], roads.point_start[number + 1] - 2
    point, _, _, _ = nearest_segment(roads, first, last, x, y, np.nan)
    return is_level(roads.point_z[point], state.vehicles.height[row, slot])


@kernel
def _has_left_map(state: State, roads: Roads, row: int, agent_id: int) -> bool:
    """Return whether an agent without a goal on the map has driven off it, over the end of a road."""
    goal, slot = state.missions.goal[row, agent_id], state.agents.slot[row, agent_id]
    lane = lane_of(state, roads, state.vehicles, row, slot)
    if goal not in (_ENDLESS, _OFF_MAP) or state.agents.on_road[row, agent_id] or lane < 0:
        return False
    is_at_end = state.vehicles.lane_position[row, slot] >= lane_length(roads, lane) - _AT_END
    is_ahead = abs(state.vehicles.lane_offset[row, slot]) <= roads.lane_width[lane]
    if not (roads.lane_dead_end[lane] and is_at_end and is_ahead):
        return False
    x, y, _, _ = _way(state, row, slot)
    return is_on_road(roads, state.map[row], x, y, state.vehicles.height[row, slot], _ROAD, True)


@kernel
def _road_events(
    state: State, roads: Roads, routes: RouteTable, patience: int, row: int, agent_id: int
) -> int:
    """Return how the vehicle stands to the road and to its route."""
    agents, slot = state.agents, state.agents.slot[row, agent_id]
    bits = 0
    if not agents.on_road[row, agent_id]:
        bits |= _OFF_ROAD
    if agents.corners_on_road[row, agent_id] < 4:
        bits |= _ON_SHOULDER
    if agents.on_road[row, agent_id] and _is_against_lane(state, roads, row, slot):
        bits |= _WRONG_WAY
    if not _is_off_route(state, roads, routes, row, agent_id):
        agents.off_route_since[row, agent_id] = -1
    elif agents.off_route_since[row, agent_id] < 0:
        agents.off_route_since[row, agent_id] = state.step[row]
    elif state.step[row] - agents.off_route_since[row, agent_id] >= patience:
        bits |= _OFF_ROUTE
    return bits


@kernel
def _is_against_lane(state: State, roads: Roads, row: int, slot: int) -> bool:
    """Return whether a vehicle points against the direction of its lane; inside junctions none does."""
    lane = lane_of(state, roads, state.vehicles, row, slot)
    if lane < 0 or roads.lane_inside[lane]:
        return False
    s = state.vehicles.lane_position[row, slot]
    point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
    return math.cos(state.vehicles.heading[row, slot] - centre_at(roads, point, s)[2]) < 0.0


@kernel
def _is_off_route(state: State, roads: Roads, routes: RouteTable, row: int, agent_id: int) -> bool:
    """Return whether an agent has left its route; the opposite direction of the same road does not count."""
    if state.agents.on_route[row, agent_id] or routes.number[row, agent_id] < 0:
        return False
    if state.missions.goal[row, agent_id] in (_ENDLESS, _OFF_MAP):
        return False
    if not state.agents.on_road[row, agent_id]:
        return True
    lane = lane_of(state, roads, state.vehicles, row, state.agents.slot[row, agent_id])
    twin = roads.lane_twin[lane] if lane >= 0 else -1
    return corridor_row(state, routes, row, agent_id, twin) < 0


@kernel
def _via_events(state: State, roads: Roads, row: int, agent_id: int) -> int:
    """Mark the via points that were passed, each once, or once in every lap."""
    missions, slot = state.missions, state.agents.slot[row, agent_id]
    lap, bits = state.agents.lap[row, agent_id], 0
    begins_lap = state.agents.lap_before[row, agent_id] < lap < missions.laps[row, agent_id]
    for via in range(missions.via_count[row, agent_id]):
        if begins_lap and missions.goal[row, agent_id] == _LAPS:
            state.agents.via_hit[row, agent_id, via] = False
        x, y = missions.via_position[row, agent_id, via]
        is_new = not state.agents.via_hit[row, agent_id, via]
        lane, radius = missions.via_lane[row, agent_id, via], missions.via_radius[row, agent_id, via]
        if is_new and _passes(state, roads, row, slot, lane, x, y, radius):
            state.agents.via_hit[row, agent_id, via] = True
            bits = _VIA_HIT
    return bits


@kernel
def _rests(
    state: State, roads: Roads, routes: RouteTable, rules: AgentRules, row: int, agent_id: int
) -> bool:
    """Return whether the vehicle has stayed near one place for too long; see `_has_to_wait`."""
    agents, slot = state.agents, state.agents.slot[row, agent_id]
    x, y = state.vehicles.position[row, slot]
    rest = agents.last_moved_position[row, agent_id]
    if math.hypot(x - rest[0], y - rest[1]) >= rules.not_moving_distance[agent_id]:
        rest[0], rest[1] = x, y
        agents.last_moved_step[row, agent_id] = state.step[row]
    elif _has_to_wait(state, roads, routes, row, agent_id):
        agents.last_moved_step[row, agent_id] += 1
    return state.step[row] - agents.last_moved_step[row, agent_id] >= rules.not_moving_steps[agent_id]


@kernel
def _has_to_wait(state: State, roads: Roads, routes: RouteTable, row: int, agent_id: int) -> bool:
    """Return whether a vehicle waits near a red light, behind one that stands, or for crossing vehicles.

    Waiting is not resting. The first of a queue at a green light or a crossing rests while no vehicle comes
    (`yields_to_stream`); as soon as it has moved, or is gone, the next is the first.
    """
    now, slot = state.vehicles, state.agents.slot[row, agent_id]
    lane = lane_of(state, roads, now, row, slot)
    if lane >= 0 and lane_length(roads, lane) - now.lane_position[row, slot] <= QUEUE_AT_LIGHT:
        here, base = corridor_row(state, routes, row, agent_id, lane), roads.lane_base[state.map[row]]
        free = routes.start[state.map[row]]
        if here < 0:
            here = free + lane - base
        if light_ahead(routes, int(here), base, free, state.signals[row]) == _STOP:
            return True
    if abs(now.speed[row, slot]) >= STANDING:
        return False
    x, y = now.position[row, slot]
    cos, sin = math.cos(now.heading[row, slot]), math.sin(now.heading[row, slot])
    for other in range(now.alive.shape[1]):
        if not meets(now, row, slot, other) or abs(now.speed[row, other]) >= STANDING:
            continue
        dx, dy = now.position[row, other, 0] - x, now.position[row, other, 1] - y
        ahead, aside = dx * cos + dy * sin, abs(dy * cos - dx * sin)
        gap = ahead - 0.5 * (now.length[row, slot] + now.length[row, other])
        if ahead <= 0.0 or gap > QUEUE_GAP or aside > 0.5 * (now.width[row, slot] + now.width[row, other]):
            continue
        # Two that face each other do not wait for each other.
        if math.cos(now.heading[row, other] - now.heading[row, slot]) > 0.0:
            return True
    return yields_to_stream(state, roads, routes, row, agent_id)


@kernel
def _goal_events(state: State, roads: Roads, routes: RouteTable, row: int, agent_id: int) -> int:
    """Return whether an agent on the road reached or missed its goal, or completed a lap."""
    goal = state.missions.goal[row, agent_id]
    if goal in (_ENDLESS, _OFF_MAP):
        return 0
    behind, crossed, is_last = _at_line(state, roads, routes, row, agent_id)
    if goal == _LAPS:
        laps, before = state.missions.laps[row, agent_id], state.agents.lap_before[row, agent_id]
        # Map matching counts laps on the route, which a vehicle has left that crosses a line at its very end.
        if crossed and is_last and before == laps - 1:
            state.agents.lap[row, agent_id] = laps
        lap = state.agents.lap[row, agent_id]
        bits = _LAP_COMPLETED if lap > before else 0
        return bits | (_REACHED if lap >= laps else 0)
    if crossed and crossed - 1 == state.missions.goal_lane[row, agent_id] and is_last:
        return _REACHED
    if goal == _POSITION and _is_at_goal(state, roads, routes, row, agent_id):
        return _REACHED
    return _MISSED if is_last and behind > MISSED_BY else 0


@kernel
def _is_at_goal(state: State, roads: Roads, routes: RouteTable, row: int, agent_id: int) -> bool:
    """Return whether the centre is within the goal's radius, on routes that pass it again the last time."""
    missions, slot = state.missions, state.agents.slot[row, agent_id]
    x, y = missions.goal_position[row, agent_id]
    lane, radius = missions.goal_lane[row, agent_id], missions.goal_radius[row, agent_id]
    if not _passes(state, roads, row, slot, lane, x, y, radius):
        return False
    lane = lane_of(state, roads, state.vehicles, row, slot)
    is_on_route = corridor_row(state, routes, row, agent_id, lane) >= 0
    return not is_on_route or _is_last_time(state, roads, routes, row, agent_id, lane)


@kernel
def _is_last_time(state: State, roads: Roads, routes: RouteTable, row: int, agent_id: int, lane: int) -> bool:
    """Return whether the rest of the route does not use this lane again; True without a route."""
    here = corridor_row(state, routes, row, agent_id, lane)
    if here < 0:
        return bool(routes.number[row, agent_id] < 0)
    corridor = routes.free + routes.number[row, agent_id]
    again = 0
    for later in range(here + 1, routes.start[corridor + 1]):
        again += routes.lane[later] == lane
    return again == 0


@kernel
def _at_line(
    state: State, roads: Roads, routes: RouteTable, row: int, agent_id: int
) -> tuple[float, int, bool]:
    """Return how the vehicle stands to the goal's line, which runs across the whole road of the goal's lane.

    Returns:
        How far it is behind the line [m]: infinite for one that has left the road behind the line, and
        -infinity where it has nothing to do with the line; the lane, within its map, on which it crossed the
        line in this step, plus one, 0 if it did not; whether the route leads there for the last time.
    """
    slot = state.agents.slot[row, agent_id]
    if state.missions.goal_lane[row, agent_id] < 0:
        return -np.inf, 0, False
    base = roads.lane_base[state.map[row]]
    goal_lane, goal_s = base + state.missions.goal_lane[row, agent_id], state.missions.goal_s[row, agent_id]
    edge = roads.lane_edge[goal_lane]
    lane = lane_of(state, roads, state.vehicles, row, slot)
    is_known = was_there(state.vehicles, state.before, row, slot)
    old = lane_of(state, roads, state.before, row, slot) if is_known else -1
    is_there = lane >= 0 and roads.lane_edge[lane] == edge
    came_from = old >= 0 and roads.lane_edge[old] == edge
    begin_x, begin_y, end_x, end_y = _way(state, row, slot)
    line = line_on(roads, goal_lane, goal_s, old) if came_from else 0.0
    before = state.before.lane_position[row, slot] - line
    if is_there:
        behind = state.vehicles.lane_position[row, slot] - line_on(roads, goal_lane, goal_s, lane)
        if not came_from:
            before = behind - math.hypot(end_x - begin_x, end_y - begin_y)
        crossed = int(lane - base + 1 if old >= 0 and before < 0.0 <= behind else 0)
        return behind, crossed, _is_last_time(state, roads, routes, row, agent_id, lane)
    if came_from:
        end = lane_length(roads, old) - line
        behind = place_on_lane(roads, old, end_x, end_y, state.vehicles.height[row, slot])[0] - line
        if behind >= end - AT_JOINT:
            behind = max(behind, end)
        crossed = int(old - base + 1 if before < 0.0 <= behind else 0)
        return (
            np.inf if behind >= end else -np.inf,
            crossed,
            _is_last_time(state, roads, routes, row, agent_id, old),
        )
    return -np.inf, 0, False
