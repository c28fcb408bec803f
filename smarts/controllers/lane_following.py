"""Lane following by target speed and lane-change commands."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from smarts.arrays import Bools, Floats
from smarts.controllers.action_formats import ActionFormat, NumbersFormat
from smarts.controllers.drivable_path import PLANNED, is_tight, plan_drivable_path
from smarts.controllers.lane_changes import is_changing, latch
from smarts.controllers.lane_ends import merge_before_end, stop_before_end
from smarts.controllers.lane_path import TRACKED_OFFSET, limit_speeds, write_reference
from smarts.controllers.leaders import limit_by_leaders
from smarts.controllers.stop_lines import limit_by_lights, limit_by_right_of_way
from smarts.controllers.task_path import write_task_reference
from smarts.controllers.tracking import SPEED_GAIN
from smarts.dynamics.performance import Abilities, performance
from smarts.geometry.binding import LateBound
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.paces import Performance
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, CommandMode, Commands, LaneAction
from smarts.types.agent_states import AgentStatus, ChangePhase
from smarts.types.guidance import GuidePhase
from smarts.types.vehicles import Owner
from smarts.types.world import State

CHANGE_SPEED = 12.5
"""Maximum speed during a discrete lane change [m/s]."""
SLOWING = 2.5
"""Deceleration of `slow_down` [m/s^2]."""

BY_SPEED, BY_NAME, FALLBACK = 0, 1, 2
"""Command types of `follow_lanes`: target speed and lane change, `LaneAction`, or none."""

_MANOEUVRE = int(GuidePhase.MANOEUVRE)
_NO_CHANGE = int(ChangePhase.NONE)
_TRACK, _ACTUATORS = int(CommandMode.TRACK), int(CommandMode.ACTUATORS)
_LEAVING, _NOBODY = int(AgentStatus.LEAVING), int(Owner.NOBODY)
_SLOW = int(LaneAction.slow_down)
_LEFT, _RIGHT = int(LaneAction.change_lane_left), int(LaneAction.change_lane_right)


@kernel
def follow_lanes(
    state: State,
    roads: Roads,
    routes: RouteTable,
    abilities: Abilities,
    performance: Performance,
    command_type: int,
    speeds: Floats,
    actions: Actions,
    commands: Commands,
    chosen: Bools,
) -> None:
    """Write the references of chosen agents.

    Args:
        state: The state of the world; lane-change state, `effective` and desired speed are written.
        roads: The maps' lanes.
        routes: The agents' routes.
        abilities: Limits of each kind of vehicle.
        performance: What each kind can do on its way through junctions.
        command_type: `BY_SPEED`, `BY_NAME` or `FALLBACK`.
        speeds: Maximum speed of discrete actions on each map [m/s], shape (M,).
        actions: Actions of all agents.
        commands: Mode, reference, reference length and window are written.
        chosen: The agents, shape (B, A).
    """
    vehicles, agents, guidance = state.vehicles, state.agents, state.guidance
    mode, reference, length = commands.mode, commands.reference, commands.reference_length
    values = actions.values
    for b in range(chosen.shape[0]):
        for a in range(chosen.shape[1]):
            if not chosen[b, a]:
                continue
            slot = agents.slot[b, a]
            if agents.entry_step[b, a] == state.step[b]:
                agents.target_lane[b, a] = -1
                agents.change_phase[b, a] = 0
            is_manoeuvring = guidance.phase[b, a] == _MANOEUVRE
            change = _change_of(command_type, values[b, a])
            row, s, t = latch(
                state,
                roads,
                routes,
                b,
                a,
                0 if is_manoeuvring else change,
                actions.fresh[b, a],
                actions.action_mask[b, a],
            )
            mode[b, a], length[b, a] = _TRACK, 0
            _stand_if_lost(state, commands, b, a, row)
            if row < 0:
                continue
            # The fallback's vehicle, whose agent is done, may leave the map.
            may_leave = command_type == FALLBACK or is_manoeuvring
            row, s, t, room, end = merge_before_end(state, roads, routes, b, a, row, s, t, change, may_leave)
            cap, desired = _speed_limits(
                roads.lane_speed[routes.lane[row]],
                speeds[state.map[b]],
                guidance.speed[b, a],
                command_type,
                values[b, a, 0],
                is_changing(agents.change_phase[b, a]),
            )
            vehicles.desired_speed[b, slot] = desired
            points = reference[b, a]
            speed = vehicles.speed[b, slot]
            obey_limit = command_type != BY_SPEED
            if is_manoeuvring:
                # After the curve, the agent's target lane is the lane of its vehicle.
                agents.target_lane[b, a], agents.change_phase[b, a] = -1, _NO_CHANGE
                write_task_reference(state, roads, routes, b, a, abilities, cap, obey_limit, points)
            else:
                if _write_lane_reference(
                    state, roads, routes, b, a, abilities, row, s, t, cap, obey_limit, points
                ):
                    commands.window[b, a] = PLANNED
            if command_type == BY_NAME and int(values[b, a, 0]) == _SLOW:
                _slow_down(points, speed)
            elif command_type == FALLBACK:
                _limit_fallback(state, roads, routes, performance, b, a, row, s, points)
            stop_before_end(state, roads, routes, b, a, end, room, points)
            length[b, a] = len(points)


@kernel
def _stand_if_lost(state: State, commands: Commands, b: int, a: int, row: int) -> None:
    """Let a vehicle whose agent is leaving brake and stand if it has collided or has no lane (row -1)."""
    agents = state.agents
    # `FallbackController` is the only one that drives these vehicles.
    if agents.state[b, a] == _LEAVING and (row < 0 or agents.harmed[b, a]):
        commands.mode[b, a] = _ACTUATORS
        commands.actuators[b, a, 0], commands.actuators[b, a, 1] = 0.0, 1.0
        commands.actuators[b, a, 2] = 0.0


@kernel
def _limit_fallback(
    state: State,
    roads: Roads,
    routes: RouteTable,
    performance: Performance,
    b: int,
    a: int,
    row: int,
    s: float,
    points: Floats,
) -> None:
    """Lower a reference's speeds behind others and, for a vehicle of traffic, at lights and junctions."""
    slot = state.agents.slot[b, a]
    limit_by_leaders(state, b, slot, points)
    if state.vehicles.home[b, slot] != _NOBODY:
        limit_by_lights(state, roads, routes, b, slot, row, s, points)
        limit_by_right_of_way(state, roads, routes, performance, b, slot, row, s, points)


@kernel
def _write_lane_reference(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    a: int,
    abilities: Abilities,
    row: int,
    s: float,
    t: float,
    cap: float,
    obey_limit: bool,
    points: Floats,
) -> bool:
    """Write a reference along a lane; return whether `plan_drivable_path` replaced points of a tight lane."""
    vehicles, agents = state.vehicles, state.agents
    slot, map_id = agents.slot[b, a], state.map[b]
    kind, speed = vehicles.kind[b, slot], vehicles.speed[b, slot]
    agility, sharpest = abilities.agility[kind], abilities.sharpest[kind]
    write_reference(roads, routes, map_id, row, s, t, speed, cap, obey_limit, agility, points)
    curvature = math.tan(agents.steering[b, a]) / abilities.wheelbase[kind]
    if not is_tight(points, curvature, sharpest):
        return False
    if abs(t) > TRACKED_OFFSET and not is_changing(agents.change_phase[b, a]):
        # The plan itself leads back to the lane.
        write_reference(roads, routes, map_id, row, s, 0.0, speed, cap, obey_limit, agility, points)
    pose = vehicles.position[b, slot, 0], vehicles.position[b, slot, 1], vehicles.heading[b, slot]
    height = vehicles.height[b, slot]
    plan_drivable_path(roads, map_id, points, pose, height, curvature, speed, kind, abilities)
    limit_speeds(points, len(points), agility)
    return True


@kernel
def _speed_limits(
    limit: float, top: float, task_speed: float, command_type: int, requested: float, is_changing_lane: bool
) -> tuple[float, float]:
    """Return the maximum speed of a reference and the vehicle's desired speed [m/s].

    Args:
        limit: Speed limit of the lane [m/s].
        top: Maximum speed of discrete actions on this map [m/s].
        task_speed: Speed of the mission's task [m/s], 0 for none.
        command_type: `BY_SPEED`, `BY_NAME` or `FALLBACK`.
        requested: First value of the action: the target speed [m/s] if `BY_SPEED`.
        is_changing_lane: Whether the vehicle is changing lanes.
    """
    cap, desired = top, min(limit, top)
    if command_type == BY_SPEED:
        cap = desired = max(requested, 0.0)
    elif command_type == BY_NAME and is_changing_lane:
        cap = min(cap, CHANGE_SPEED)
    if task_speed > 0.0:
        cap, desired = min(cap, task_speed), min(desired, task_speed)
    return cap, desired


@kernel
def _change_of(command_type: int, values: Floats) -> int:
    """Return the lane change of an action: 1 left, -1 right, 0 none."""
    if command_type == BY_SPEED:
        return 1 if values[1] > 0.5 else (-1 if values[1] < -0.5 else 0)
    if command_type == BY_NAME:
        return 1 if int(values[0]) == _LEFT else (-1 if int(values[0]) == _RIGHT else 0)
    return 0


@kernel
def _slow_down(points: Floats, speed: float) -> None:
    """Lower a reference's speeds to a constant deceleration from `speed` [m/s] to standstill."""
    gone = 0.0
    for i in range(len(points)):
        if i > 0:
            gone += math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        square = max(speed, 0.0) ** 2 - 2.0 * SLOWING * gone
        target = math.sqrt(max(square, 0.0))
        if speed < SLOWING:
            # The stopping distance is shorter than the spacing of points: brake by the speed error alone.
            target = max(speed - SLOWING / SPEED_GAIN, 0.0)
        points[i, 3] = min(points[i, 3], target)


class LaneFollowing:
    """Keeps a lane at a target speed; a fresh command of -1 or 1 changes to the right or left lane.

    Values: target speed [m/s], lane change. Lateral acceleration limits the speed before and in curves
    (`lane_path.CURVE_ACCELERATION`). The vehicle keeps its lane even where the lane leaves the route. Where
    the lane ends, it merges into one beside that leads on, or stops before the end (`lane_ends`). A
    mission's task (`smarts.types.guidance`) limits the speed; during its manoeuvre the vehicle follows the
    task's curve, and lane-change commands have no effect.

    Args:
        scene: The world, its maps and its routes.
        speeds: Maximum speed of discrete actions on each map [m/s], shape (M,); unlimited by default.
    """

    action_format: ClassVar[ActionFormat] = NumbersFormat([0, -1], [60, 1], whole=[1])
    follows_lanes: ClassVar[bool] = True
    command_type: ClassVar[int] = BY_SPEED

    def __init__(self, scene: Scene, speeds: Floats | None = None) -> None:
        top_speeds = np.full(len(scene.atlas.graphs), np.inf)
        if speeds is not None:
            top_speeds[:] = speeds
        given = scene.world.state, scene.atlas.roads, scene.routes.current
        kinds = Abilities.of_all(), performance(scene.atlas)
        self._follow = LateBound(follow_lanes, *given, *kinds, self.command_type, top_speeds)

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the reference along each chosen agent's lane; see `Controller`."""
        self._follow.to(actions, out)(chosen)
