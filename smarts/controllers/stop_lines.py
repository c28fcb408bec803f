"""Stops before red lights and where others go first; used by `FallbackController`."""

from __future__ import annotations

from smarts.arrays import Floats
from smarts.controllers.leaders import brake_to
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.roads.lights import light_ahead
from smarts.roads.paces import Performance
from smarts.roads.right_of_way import gap_to_wait
from smarts.types.traffic import Signal
from smarts.types.world import State

GAP = 1.0
"""Gap to the stop line [m]."""
HARDEST = 6.0
"""A vehicle that would have to brake harder drives on [m/s^2]."""
CLOSE = 0.3
"""A vehicle that is nearer to where it waits stands, so that it does not creep on [m]."""

_STOP = int(Signal.STOP)


@kernel
def limit_by_lights(
    state: State, roads: Roads, routes: RouteTable, b: int, slot: int, row: int, s: float, points: Floats
) -> None:
    """Lower a reference's speeds so that the vehicle stops before a red light at the end of its lane.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: The simulation.
        slot: The vehicle.
        row: The row in `routes` of the lane that it steers for.
        s: Position of its centre along the lane [m].
        points: The reference, shape (R, 4), see `Commands`; its speeds are lowered.
    """
    vehicles, m = state.vehicles, state.map[b]
    if light_ahead(routes, row, roads.lane_base[m], routes.start[m], state.signals[b]) != _STOP:
        return
    room = lane_length(roads, routes.lane[row]) - s - 0.5 * vehicles.length[b, slot]
    speed = max(vehicles.speed[b, slot], 0.0)
    if room >= 0.0 and speed * speed <= 2.0 * HARDEST * room:
        brake_to(points, room - GAP, 0.0)


@kernel
def limit_by_right_of_way(
    state: State,
    roads: Roads,
    routes: RouteTable,
    performance: Performance,
    b: int,
    slot: int,
    row: int,
    s: float,
    points: Floats,
) -> None:
    """Lower a reference's speeds so that the vehicle waits at junctions where others go first.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        performance: Performance of each kind of vehicle.
        b: The simulation.
        slot: The vehicle.
        row: The row in `routes` of the lane that it steers for.
        s: Position of its centre along the lane [m].
        points: The reference, shape (R, 4), see `Commands`; its speeds are lowered.
    """
    room = gap_to_wait(state, roads, routes, performance, b, slot, row, s)
    speed = max(state.vehicles.speed[b, slot], 0.0)
    if speed * speed <= 2.0 * HARDEST * room:
        brake_to(points, room - min(GAP, 0.5 * room) if room > CLOSE else -GAP, 0.0)
