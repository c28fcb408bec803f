"""Kernel for the reference along the curve of a mission's task, such as a U-turn."""

from __future__ import annotations

from smarts.arrays import Floats
from smarts.controllers.lane_path import NEAR_SPACING, limit_speeds, write_reference
from smarts.dynamics.performance import Abilities
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.curves import curve_into, pose_along, station_near, stations_of
from smarts.roads.lane_ways import row_of
from smarts.types.world import State


@kernel
def write_task_reference(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    a: int,
    abilities: Abilities,
    cap: float,
    obey_limit: bool,
    reference: Floats,
) -> None:
    """Write the reference along the curve of an agent's manoeuvre and the lane after it.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: The simulation.
        a: The agent.
        abilities: Limits of each kind of vehicle.
        cap: Maximum speed [m/s].
        obey_limit: Whether the speed limit of the lane after the curve applies too.
        reference: The reference, written, shape (R, 4), see `Commands`.
    """
    vehicles, agents, guidance = state.vehicles, state.agents, state.guidance
    map_id, slot = state.map[b], agents.slot[b, a]
    first_lane = roads.lane_base[map_id]
    lane = first_lane + guidance.lane[b, a]
    agility = abilities.agility[vehicles.kind[b, slot]]
    control = curve_into(roads, guidance.begin[b, a], lane, guidance.s[b, a])
    stations = stations_of(control)
    x, y = vehicles.position[b, slot]
    station = station_near(control, stations, x, y)[0]
    on_curve = 0
    while on_curve < len(reference) and station < stations[-1]:
        point = reference[on_curve]
        point[0], point[1], point[2] = pose_along(control, stations, station)
        point[3] = min(cap, roads.lane_speed[lane]) if obey_limit else cap
        station += NEAR_SPACING
        on_curve += 1
    after_curve = reference[on_curve:]
    if len(after_curve) > 0:
        row = row_of(routes, map_id, routes.number[b, a], lane, first_lane, agents.route_progress[b, a])
        s = guidance.s[b, a] + station - stations[-1]
        write_reference(
            roads, routes, map_id, row, s, 0.0, vehicles.speed[b, slot], cap, obey_limit, agility, after_curve
        )
    limit_speeds(reference, len(reference), agility)
