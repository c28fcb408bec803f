"""Kernels: the reference of a vehicle that its mission's task leads along a curve into another lane."""

from __future__ import annotations

from smarts.arrays import Floats
from smarts.controllers.abilities import Abilities
from smarts.controllers.lane_path import NEAR_SPACING, limit_speeds, row_of, write_reference
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.curves import curve_into, pose_along, station_near, stations_of
from smarts.types.world import State


@kernel
def write_led_reference(
    state: State,
    roads: Roads,
    routes: RouteTable,
    b: int,
    a: int,
    abilities: Abilities,
    cap: float,
    obeys: bool,
    reference: Floats,
) -> None:
    """Write the points that lead a vehicle along the curve of its manoeuvre and on along the lane behind it.

    Args:
        state: Of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: Simulation.
        a: Agent.
        abilities: Of the kinds of vehicles.
        cap: The largest speed [m/s].
        obeys: Whether the limit of the lane behind the curve holds too.
        reference: Written, shape (R, 4), see `Commands`.
    """
    vehicles, agents, guidance = state.vehicles, state.agents, state.guidance
    world, slot = state.map[b], agents.slot[b, a]
    first_lane = roads.lane_base[world]
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
        point[3] = min(cap, roads.lane_speed[lane]) if obeys else cap
        station += NEAR_SPACING
        on_curve += 1
    behind = reference[on_curve:]
    if len(behind) > 0:
        row = row_of(routes, world, routes.number[b, a], lane, first_lane, agents.route_progress[b, a])
        s = guidance.s[b, a] + station - stations[-1]
        write_reference(
            roads, routes, world, row, s, 0.0, vehicles.speed[b, slot], cap, obeys, agility, behind
        )
    limit_speeds(reference, len(reference), agility)
