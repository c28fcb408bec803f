"""Where vehicles are, for kernels: on which lanes, in which rows of routes, and how far from each other.

Kernels take `state`, `roads` and `routes` whole: the arrays of the world, of the atlas and of its routes.
Axis letters: B simulations, A agents, V vehicle slots, W via points, L lanes.
"""

from __future__ import annotations

import math

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import centre_at, find_row, lane_length
from smarts.roads.lane_ways import place_on_lane
from smarts.roads.waypoints import foot_between
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State


@kernel
def lane_of(state: State, roads: Roads, vehicles: VehicleStates, b: int, slot: int) -> int:
    """Return the lane of one of `vehicles`, now or before, numbered across all maps; -1 without one."""
    lane = vehicles.lane[b, slot]
    return roads.lane_base[state.map[b]] + lane if lane >= 0 else -1


@kernel
def was_there(now: VehicleStates, before: VehicleStates, b: int, slot: int) -> bool:
    """Return whether a slot held the same vehicle a step ago."""
    return before.alive[b, slot] and before.generation[b, slot] == now.generation[b, slot]


@kernel
def corridor_row(state: State, routes: RouteTable, b: int, a: int, lane: int) -> int:
    """Return the row of a lane in an agent's route, where the agent is along it; -1 off the route."""
    if lane < 0 or routes.number[b, a] < 0:
        return -1
    return find_row(routes, routes.free + routes.number[b, a], lane, state.agents.route_progress[b, a])


@kernel
def distance_between(vehicles: VehicleStates, b: int, slot: int, other: int) -> float:
    """Return the distance between the centres of two vehicles [m]."""
    own, its = vehicles.position[b, slot], vehicles.position[b, other]
    return math.hypot(its[0] - own[0], its[1] - own[1])


@kernel
def beside(vehicles: VehicleStates, roads: Roads, b: int, slot: int, lane: int) -> tuple[float, float]:
    """Return where on a lane a vehicle's centre is and how much of it is left [m]; < 0 beyond the ends."""
    x, y = vehicles.position[b, slot]
    s, _ = place_on_lane(roads, lane, x, y, vehicles.height[b, slot])
    return s, lane_length(roads, lane) - s


@kernel
def line_on(roads: Roads, goal_lane: int, goal_s: float, lane: int) -> float:
    """Return where a line square to a road crosses one of its lanes [m]: in bends, lanes differ in length.

    It crosses near the place as far along the lane, in shares of its length: where the road comes back to
    itself, another place may be nearer.

    Args:
        roads: The maps' lanes.
        goal_lane: The lane on which the line is given.
        goal_s: Where it crosses that lane [m].
        lane: The other lane.
    """
    if lane == goal_lane:
        return goal_s
    first, last = roads.point_start[goal_lane], roads.point_start[goal_lane + 1]
    x, y, _ = centre_at(roads, segment_at(roads.point_s, first, last, goal_s), goal_s)
    own, its = lane_length(roads, lane), lane_length(roads, goal_lane)
    between = abs(roads.lane_index[lane] - roads.lane_index[goal_lane]) * roads.lane_width[goal_lane]
    # Within half a turn of the road, lanes differ by so much in length.
    near, reach = goal_s / its * own, abs(own - its) + math.pi * between
    first, last = roads.point_start[lane], roads.point_start[lane + 1]
    return foot_between(
        roads,
        segment_at(roads.point_s, first, last, near - reach),
        segment_at(roads.point_s, first, last, near + reach),
        x,
        y,
        math.nan,
    )
