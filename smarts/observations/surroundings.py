"""The feature `surroundings`: what models of drivers decide by, in SI units."""

from __future__ import annotations

import enum
import math
from collections import namedtuple
from typing import Any

import numpy as np

from smarts.arrays import Floats
from smarts.dynamics.performance import performance
from smarts.geometry.compiling import kernel
from smarts.observations.context import AdapterContext
from smarts.observations.feature import Feature
from smarts.observations.way_ahead import SIGHT, gap_behind, leader_on, write_way
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length, pose_on_lane
from smarts.roads.lane_ways import place_on_lane, row_of
from smarts.roads.paces import Performance
from smarts.roads.right_of_way import gap_to_wait
from smarts.types.agent_states import ChangePhase
from smarts.types.interface import Field
from smarts.types.vehicles import Owner
from smarts.types.world import State

OWN_VEHICLE, LANE_TRAFFIC = "own_vehicle", "lane_traffic"
"""Names of the fields."""
OWN, LEFT, RIGHT = 0, 1, 2
"""Rows of `lane_traffic`."""


class Own(enum.IntEnum):
    """The numbers of `own_vehicle`."""

    X = 0
    """[m]"""
    Y = 1
    HEADING = 2
    """[rad]"""
    SPEED = 3
    """[m/s]"""
    LENGTH = 4
    """[m]"""
    WIDTH = 5
    ALLOWED = 6
    """Speed limit, and what lower limits ahead allow at 1.5 m/s^2 [m/s]; 0 off the lanes."""
    CHANGING = 7
    """1 during a lane change, else 0."""
    DEMANDED = 8
    """Lane changes that the route demands, positive to the left."""
    REMAINING = 9
    """Distance left on the route [m], infinite without a goal."""
    LIGHT = 10
    """The next light on the way, a `Signal`."""
    LIGHT_GAP = 11
    """Distance of the front bumper to its line [m], infinite for none."""
    YIELD_GAP = 12
    """Distance of the front bumper to where others go first at a junction [m], infinite for none."""
    OFFSET = 13
    """To the left of the steered lane's centreline [m]."""
    TURN = 14
    """Heading relative to that lane, positive to the left [rad]."""


class Lane(enum.IntEnum):
    """The numbers of each lane in `lane_traffic`."""

    OPEN = 0
    """1 if the vehicle may drive in the lane; if 0 the next numbers are those of an empty lane."""
    AHEAD = 1
    """Gap to the leader, bumper to bumper, negative beside [m]; infinite for none."""
    AHEAD_SPEED = 2
    """[m/s]"""
    BEHIND = 3
    """Gap to the follower [m]; infinite for none."""
    BEHIND_SPEED = 4
    """[m/s]"""
    BEHIND_DESIRED = 5
    """Speed of the follower on a free road [m/s]."""
    LEFT = 6
    """Distance of the front bumper to where the lane ends or leaves the route [m], or infinite."""
    ALLOWED = 7
    """As `Own.ALLOWED` [m/s]."""
    END = 8
    """Distance of the front bumper to where the lane ends and others do not [m], or infinite; for a vehicle
    that did not come from traffic also to where the road ends, unless its goal is before that."""


# Numbers, for kernels.
_X, _Y, _HEADING, _SPEED, _LENGTH, _WIDTH, _ALLOWED, _CHANGING = map(int, [*Own][:8])
_DEMANDED, _REMAINING, _LIGHT, _LIGHT_GAP, _YIELD_GAP, _OFFSET, _TURN = map(int, [*Own][8:])
_OPEN, _AHEAD, _AHEAD_SPEED, _BEHIND, _BEHIND_SPEED, _BEHIND_DESIRED, _LEFT, _LANE_ALLOWED, _END = map(
    int, Lane
)
_ENDLESS, _NOBODY = 0, int(Owner.NOBODY)
_NO_CHANGE = (int(ChangePhase.NONE), int(ChangePhase.SETTLED), int(ChangePhase.ABORTED))


_Out = namedtuple("_Out", "own_vehicle lane_traffic")


class Surroundings(Feature):
    """State of the vehicle, lights and junctions ahead, and the traffic in its lane and those beside.

    `own_vehicle` holds the numbers of `Own`, `lane_traffic` those of `Lane` for the own lane (the one that
    the vehicle steers for), the left and the right one. Vehicles are seen up to 150 m along the way: the
    lanes of the route, elsewhere the straightest ones. A leader is a vehicle whose footprint is on that way.

    Args:
        context: The agents.
        margins: The driver's margins in time at junctions, in those of `smarts/roads/precedence.py`.
    """

    in_vector = False

    def __init__(self, context: AdapterContext, margins: float = 1.0) -> None:
        super().__init__(context)
        self._margins = float(margins)

    def fields(self) -> tuple[Field, ...]:
        """Return `own_vehicle` and `lane_traffic`."""
        meaning = "SI units; see smarts/observations/surroundings.py"
        return (
            Field(
                OWN_VEHICLE, (len(Own),), np.float64, -np.inf, np.inf, "", f"the own vehicle, in {meaning}"
            ),
            Field(LANE_TRAFFIC, (3, len(Lane)), np.float64, -np.inf, np.inf, "", f"traffic, in {meaning}"),
        )

    arrays = _Out

    def known(self) -> tuple[Any, ...]:
        """Return what vehicles can do, and the driver's margins."""
        return ((performance(self.context.scene.atlas), self._margins),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: _Out, known: Any
    ) -> None:
        """Write an agent's numbers; see `Feature`."""
        performance, margins = known
        own, lanes = out.own_vehicle[b, g], out.lane_traffic[b, g]
        _write(state, roads, routes, performance, b, a, margins, own, lanes)


@kernel
def _write(
    state: State,
    roads: Roads,
    routes: RouteTable,
    performance: Performance,
    b: int,
    a: int,
    margins: float,
    own: Floats,
    lanes: Floats,
) -> None:
    """Write the numbers of one agent."""
    vehicles, agents, m = state.vehicles, state.agents, state.map[b]
    slot, first_lane = agents.slot[b, a], roads.lane_base[m]
    _write_vehicle(state, b, a, slot, own)
    for side in range(3):
        _clear(lanes[side])
    here = vehicles.lane[b, slot]
    if here < 0:
        return
    target = agents.target_lane[b, a]
    x, y = vehicles.position[b, slot]
    height = vehicles.height[b, slot]
    route, hint = routes.number[b, a], agents.route_progress[b, a]
    row = row_of(routes, m, route, first_lane + (target if target >= 0 else here), first_lane, hint)
    s, t = place_on_lane(roads, routes.lane[row], x, y, height)
    if s > lane_length(roads, routes.lane[row]):
        # The vehicle has left the lane that it steered for: the next one is settled with its next command.
        row = row_of(routes, m, route, first_lane + here, first_lane, hint)
        s, t = place_on_lane(roads, routes.lane[row], x, y, height)
    lane = int(routes.lane[row])
    turn = vehicles.heading[b, slot] - pose_on_lane(roads, lane, s)[2]
    own[_OFFSET], own[_TURN] = t, math.atan2(math.sin(turn), math.cos(turn))
    goal = _distance_to_goal(state, b, a)
    light, light_gap = _write_lane(state, roads, routes, b, slot, row, s, route, goal, lanes[0])
    own[_ALLOWED], own[_LIGHT], own[_LIGHT_GAP] = lanes[0, _LANE_ALLOWED], light, light_gap
    own[_YIELD_GAP] = gap_to_wait(state, roads, routes, performance, b, slot, row, s, margins)
    for side in range(1, 3):
        other = int(roads.lane_left[lane] if side == 1 else roads.lane_right[lane])
        if other < 0 or roads.lane_kind[other] != roads.lane_kind[lane] or roads.lane_inside[lane]:
            continue
        other_row = row_of(routes, m, route, other, first_lane, hint)
        place, _ = place_on_lane(roads, other, x, y, height)
        _write_lane(state, roads, routes, b, slot, other_row, place, route, goal, lanes[side])
    if own[_CHANGING] > 0.0 and here + first_lane != lane and not roads.lane_inside[here + first_lane]:
        # Until the change is complete, the leader in the lane that it leaves counts too.
        _keep_nearer(state, roads, routes, b, a, slot, here + first_lane, lanes[0])


@kernel
def _write_vehicle(state: State, b: int, a: int, slot: int, own: Floats) -> None:
    """Write what is known without lanes."""
    vehicles, agents = state.vehicles, state.agents
    own[:] = 0.0
    own[_X], own[_Y] = vehicles.position[b, slot]
    own[_HEADING], own[_SPEED] = vehicles.heading[b, slot], vehicles.speed[b, slot]
    own[_LENGTH], own[_WIDTH] = vehicles.length[b, slot], vehicles.width[b, slot]
    own[_CHANGING] = 0.0 if agents.change_phase[b, a] in _NO_CHANGE else 1.0
    own[_DEMANDED] = agents.lane_changes[b, a]
    own[_REMAINING] = np.inf if state.missions.goal[b, a] == _ENDLESS else agents.remaining[b, a]
    own[_LIGHT_GAP] = own[_YIELD_GAP] = np.inf


@kernel
def _distance_to_goal(state: State, b: int, a: int) -> float:
    """Return how far a vehicle may drive on its road [m]: to its goal, or infinitely off its route.

    A vehicle from traffic leaves where the road ends: 0.
    """
    agents = state.agents
    if state.vehicles.home[b, agents.slot[b, a]] != _NOBODY:
        return 0.0
    has_goal = state.missions.goal[b, a] != _ENDLESS and agents.on_route[b, a]
    return agents.remaining[b, a] if has_goal else np.inf


@kernel
def _clear(lane: Floats) -> None:
    lane[:] = 0.0
    lane[_AHEAD] = lane[_BEHIND] = lane[_LEFT] = lane[_END] = np.inf


@kernel
def _write_lane(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    slot: int,
    row: int,
    s: float,
    route: int,
    goal: float,
    out: Floats,
) -> tuple[int, float]:
    """Write a lane's numbers; return the next light on it and the gap to its line."""
    points = np.empty((SIGHT, 4))
    half = 0.5 * state.vehicles.length[b, slot]
    way = write_way(state, roads, routes, b, row, s, route, points)
    out[_OPEN] = 1.0
    end = way.end if goal <= way.over else min(way.end, way.over)
    out[_LEFT], out[_END], out[_LANE_ALLOWED] = way.left - half, end - half, way.allowed
    out[_AHEAD], out[_AHEAD_SPEED] = leader_on(state.vehicles, b, slot, points[: way.points])
    behind = gap_behind(
        state.vehicles, roads, b, slot, int(routes.lane[row]), s, state.vehicles.heading[b, slot]
    )
    out[_BEHIND], out[_BEHIND_SPEED], out[_BEHIND_DESIRED] = behind
    return way.light, way.light_distance - half


@kernel
def _keep_nearer(
    state: State, roads: Roads, routes: RouteTable, b: int, a: int, slot: int, lane: int, out: Floats
) -> None:
    """Take the leader in another lane if it is nearer."""
    m, hint = state.map[b], state.agents.route_progress[b, a]
    x, y = state.vehicles.position[b, slot]
    row = row_of(routes, m, routes.number[b, a], lane, roads.lane_base[m], hint)
    points = np.empty((SIGHT, 4))
    s, _ = place_on_lane(roads, lane, x, y, state.vehicles.height[b, slot])
    way = write_way(state, roads, routes, b, row, s, routes.number[b, a], points)
    gap, speed = leader_on(state.vehicles, b, slot, points[: way.points])
    if gap < out[_AHEAD]:
        out[_AHEAD], out[_AHEAD_SPEED] = gap, speed
