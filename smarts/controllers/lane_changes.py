"""Kernels for an agent's target lane, the state of its lane changes, and its action mask."""

from __future__ import annotations

import math

from smarts.arrays import Bools
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length, pose_on_lane
from smarts.roads.lane_graph import LaneKind
from smarts.roads.lane_ways import next_row, place_on_lane, row_of
from smarts.types.actions import LaneAction
from smarts.types.agent_states import AgentStatus, ChangePhase
from smarts.types.guidance import GuidePhase
from smarts.types.vehicles import VehicleKind
from smarts.types.world import State

LOST = 0.75
"""Offset from its target lane, in lane widths, at which a vehicle takes its current lane as target."""
LOST_WIDE = 2.0
"""The same offset during a lane change, and of vehicles longer than `LONG`, which swing wide in turns."""
LONG = 6.0
"""[m]"""
SETTLED_OFFSET = 0.25
"""A lane change is complete within this distance of the new centreline [m]..."""
SETTLED_TURN = math.radians(2.0)
"""...and within this angle of the lane's heading [rad]."""
LOOK_AHEAD = 20.0
LOOK_AHEAD_TIME = 4.0
"""A change to a lane that leaves the route is allowed until 20 m plus 4 s of travel before its end."""

_SHADOWING, _ACTIVE = int(AgentStatus.SHADOWING), int(AgentStatus.ACTIVE)
_MANOEUVRE = int(GuidePhase.MANOEUVRE)
_NONE, _REQUESTED = int(ChangePhase.NONE), int(ChangePhase.REQUESTED)
_MOVING, _SETTLED, _ABORTED = int(ChangePhase.MOVING), int(ChangePhase.SETTLED), int(ChangePhase.ABORTED)
_KEEP, _SLOW = int(LaneAction.keep_lane), int(LaneAction.slow_down)
_LEFT, _RIGHT = int(LaneAction.change_lane_left), int(LaneAction.change_lane_right)
_CAR_LANE, _BUS_LANE = int(LaneKind.CAR), int(LaneKind.BUS)
_BUS, _COACH = int(VehicleKind.BUS), int(VehicleKind.COACH)


@kernel
def is_changing(phase: int) -> bool:
    """Return whether a lane change is in progress."""
    return phase in (_REQUESTED, _MOVING)


@kernel
def steered_lane(state: State, roads: Roads, routes: RouteTable, b: int, a: int) -> tuple[int, float, float]:
    """Return the row of an agent's target lane in `routes`, and its vehicle's position s, t on it [m].

    Beyond the end of the target lane, its successor is returned. The row is -1 for a vehicle without a lane.
    """
    vehicles, agents = state.vehicles, state.agents
    slot, map_id = agents.slot[b, a], state.map[b]
    first_lane = roads.lane_base[map_id]
    x, y, height = vehicles.position[b, slot, 0], vehicles.position[b, slot, 1], vehicles.height[b, slot]
    lane = int(agents.target_lane[b, a])
    here = int(vehicles.lane[b, slot])
    if lane < 0:
        lane = here
    if lane < 0:
        return -1, 0.0, 0.0
    route, hint = routes.number[b, a], agents.route_progress[b, a]
    row = row_of(routes, map_id, route, first_lane + lane, first_lane, hint)
    if lane == here and 0.0 < vehicles.lane_position[b, slot] < lane_length(roads, routes.lane[row]):
        # Reuse the position from map matching.
        return row, vehicles.lane_position[b, slot], vehicles.lane_offset[b, slot]
    s, t = place_on_lane(roads, routes.lane[row], x, y, height)
    row, s, t = _onward(roads, routes, map_id, row, s, t, x, y, height)
    is_wide = is_changing(agents.change_phase[b, a]) or vehicles.length[b, slot] > LONG
    farthest = (LOST_WIDE if is_wide else LOST) * roads.lane_width[routes.lane[row]]
    if abs(t) > farthest and here >= 0 and _is_along(state, roads, b, slot, first_lane + here):
        row = row_of(routes, map_id, route, first_lane + here, first_lane, hint)
        s, t = place_on_lane(roads, routes.lane[row], x, y, height)
    return row, s, t


@kernel
def _is_along(state: State, roads: Roads, b: int, slot: int, lane: int) -> bool:
    """Return whether a vehicle heads along its lane; it may not where it swings wide across another lane."""
    vehicles = state.vehicles
    heading = pose_on_lane(roads, lane, vehicles.lane_position[b, slot])[2]
    return math.cos(vehicles.heading[b, slot] - heading) > 0.0


@kernel
def _onward(
    roads: Roads,
    routes: RouteTable,
    map_id: int,
    row: int,
    s: float,
    t: float,
    x: float,
    y: float,
    height: float,
) -> tuple[int, float, float]:
    """Return row, s, t of a point on a row's lane or, beyond its end, on the lanes after it."""
    for _ in range(8):
        if s <= lane_length(roads, routes.lane[row]):
            break
        following = next_row(roads, routes, map_id, row, roads.lane_base[map_id])
        if following < 0:
            break
        row = following
        s, t = place_on_lane(roads, routes.lane[row], x, y, height)
    return row, s, t


@kernel
def is_drivable(roads: Roads, lane: int, kind: int) -> bool:
    """Return whether a lane is open to a kind of vehicle."""
    if roads.lane_kind[lane] == _BUS_LANE:
        return kind in (_BUS, _COACH)
    return roads.lane_kind[lane] == _CAR_LANE


@kernel
def beside(roads: Roads, lane: int, change: int) -> int:
    """Return the lane to the left (1) or right (-1) of a lane, or -1; lanes are numbered across all maps."""
    return int(roads.lane_left[lane] if change > 0 else roads.lane_right[lane])


@kernel
def latch(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    a: int,
    change: int,
    fresh: bool,
    action_mask: Bools,
) -> tuple[int, float, float]:
    """Process a lane-change command (1 left, -1 right, 0 none); return row, s, t as `steered_lane` does.

    Only a fresh command starts a lane change, if it was allowed when the agent decided, by `action_mask`, and
    still is. The change then continues to its end, whatever later commands are, unless the opposite command
    aborts it in its first half.
    """
    vehicles, agents = state.vehicles, state.agents
    if agents.change_phase[b, a] == _SETTLED:
        agents.change_phase[b, a] = _NONE
    row, s, t = steered_lane(state, roads, routes, b, a)
    if row < 0:
        return row, s, t
    slot, map_id = agents.slot[b, a], state.map[b]
    if agents.change_phase[b, a] == _ABORTED:
        agents.change_phase[b, a] = _NONE
    lane = int(routes.lane[row])
    width = roads.lane_width[lane]
    phase = int(agents.change_phase[b, a])
    if fresh:
        agents.effective[b, a] = False
        side = _LEFT if change > 0 else _RIGHT
        is_allowed = change != 0 and action_mask[side] and agents.action_mask[b, a, side]
        target = _command(roads, lane, t, width, phase, change) if is_allowed else -1
        if target >= 0 and is_drivable(roads, target, vehicles.kind[b, slot]):
            agents.effective[b, a] = True
            phase = _REQUESTED if phase == _NONE else _ABORTED
            first_lane, route = roads.lane_base[map_id], routes.number[b, a]
            row = row_of(routes, map_id, route, target, first_lane, agents.route_progress[b, a])
            lane = target
            x, y = vehicles.position[b, slot, 0], vehicles.position[b, slot, 1]
            s, t = place_on_lane(roads, lane, x, y, vehicles.height[b, slot])
    if phase == _REQUESTED and abs(t) < 0.5 * (width + vehicles.width[b, slot]):
        phase = _MOVING
    if is_changing(phase) and abs(t) < SETTLED_OFFSET:
        heading = pose_on_lane(roads, lane, s)[2]
        if abs(wrapped(vehicles.heading[b, slot] - heading)) < SETTLED_TURN:
            phase = _SETTLED
    agents.change_phase[b, a] = phase
    agents.target_lane[b, a] = lane - roads.lane_base[map_id]
    return row, s, t


@kernel
def _command(roads: Roads, lane: int, t: float, width: float, phase: int, change: int) -> int:
    """Return the target lane of a fresh command, -1 in a lane change that it does not abort."""
    if phase != _NONE and not _can_abort(phase, t, width, change):
        return -1
    return beside(roads, lane, change)


@kernel
def _can_abort(phase: int, t: float, width: float, change: int) -> bool:
    """Return whether a command aborts the lane change: the opposite command in its first half."""
    return is_changing(phase) and change * t > 0.5 * width


@kernel
def write_action_mask(state: State, roads: Roads, routes: RouteTable, env_mask: Bools) -> None:
    """Write `action_mask` of all agents in the simulations of `env_mask`; see `ActionMasker`."""
    agents = state.agents
    for b in range(len(env_mask)):
        if not env_mask[b]:
            continue
        for a in range(agents.slot.shape[1]):
            if agents.state[b, a] not in (_ACTIVE, _SHADOWING) or agents.slot[b, a] < 0:
                continue
            mask = agents.action_mask[b, a]
            mask[_KEEP], mask[_SLOW], mask[_LEFT], mask[_RIGHT] = True, True, False, False
            row, s, t = steered_lane(state, roads, routes, b, a)
            if row >= 0 and state.guidance.phase[b, a] != _MANOEUVRE:
                mask[_LEFT] = _is_allowed(state, roads, routes, b, a, row, s, t, 1)
                mask[_RIGHT] = _is_allowed(state, roads, routes, b, a, row, s, t, -1)


@kernel
def _is_allowed(
    state: State, roads: Roads, routes: RouteTable, b: int, a: int, row: int, s: float, t: float, change: int
) -> bool:
    """Return whether a lane change, or its abort, is allowed."""
    agents = state.agents
    lane, slot, map_id = int(routes.lane[row]), agents.slot[b, a], state.map[b]
    phase = int(agents.change_phase[b, a])
    other = beside(roads, lane, change)
    if other < 0 or not is_drivable(roads, other, state.vehicles.kind[b, slot]):
        return False
    if is_changing(phase):
        return _can_abort(phase, t, roads.lane_width[lane], change)
    if roads.lane_inside[lane] or roads.lane_inside[other]:
        return False
    return _stays_on_route(state, roads, routes, b, a, other, s, map_id)


@kernel
def _stays_on_route(
    state: State, roads: Roads, routes: RouteTable, b: int, a: int, lane: int, s: float, map_id: int
) -> bool:
    """Return whether a lane is on the route and either continues on it or ends beyond the look-ahead."""
    agents = state.agents
    route = routes.number[b, a]
    if route < 0:
        return True
    first_lane = roads.lane_base[map_id]
    row = row_of(routes, map_id, route, lane, first_lane, agents.route_progress[b, a])
    if row < routes.start[routes.free]:
        return False
    if routes.onward_start[row + 1] > routes.onward_start[row]:
        return True
    # The lanes of the route's last road need no successor.
    corridor = routes.free + route
    if routes.group[row] == routes.group[routes.start[corridor + 1] - 1]:
        return True
    speed = state.vehicles.speed[b, agents.slot[b, a]]
    return lane_length(roads, lane) - s > LOOK_AHEAD + LOOK_AHEAD_TIME * speed
