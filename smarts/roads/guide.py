"""The one path of an agent that its mission's task guides."""

from __future__ import annotations

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.curves import curve_into, pose_along, station_near, stations_of
from smarts.roads.kernels import candidates, find_row, place_on_map
from smarts.roads.waypoints import WaypointPaths, clear_waypoints, foot, walk_lane, write_waypoint
from smarts.types.guidance import Guidance, GuidePhase

_APPROACH, _MANOEUVRE = int(GuidePhase.APPROACH), int(GuidePhase.MANOEUVRE)


@kernel
def is_led(guidance: Guidance, b: int, a: int) -> bool:
    """Return whether an agent has one path only: along its lane to a manoeuvre, or through it."""
    return guidance.phase[b, a] in (_APPROACH, _MANOEUVRE)


@kernel
def write_led_path(
    roads: Roads,
    table: RouteTable,
    guidance: Guidance,
    b: int,
    a: int,
    world: int,
    place: tuple[float, float, float, int],
    route: int,
    hint: float,
    mask: int,
    spacing: float,
    paths: WaypointPaths,
) -> None:
    """Write the path of an agent that is led as the only one of `paths`, which are one vehicle's.

    In a manoeuvre it begins beside the vehicle on the curve and continues along the curve's target lane;
    before, it is the vehicle's own lane. At forks it takes the first branch along the route.

    Args:
        roads: The maps' lanes.
        table: The routes.
        guidance: Of all agents.
        b: Simulation.
        a: Agent.
        world: Map number.
        place: The vehicle's x, y, height [m] and lane within the map.
        route: Number of the agent's route, -1 without one.
        hint: Distance gone along it [m].
        mask: Bit k is set if lanes of kind k count.
        spacing: Between waypoints [m].
        paths: Written.
    """
    x, y, height, lane = place
    base, i = int(roads.lane_base[world]), 0
    if guidance.phase[b, a] == _MANOEUVRE:
        lane = int(guidance.lane[b, a])
        control = curve_into(roads, guidance.begin[b, a], base + lane, guidance.s[b, a])
        i, s = _write_curve(roads, table, world, control, x, y, height, mask, spacing, paths)
        s += guidance.s[b, a]
    else:
        s = foot(roads, base + lane, x, y, height)
    row = find_row(table, table.free + route, base + lane, hint) if route >= 0 else -1
    if row < 0:
        row = table.start[world] + lane
    while row >= 0 and i < paths.heading.shape[2]:
        i, s = walk_lane(roads, table.lane[row], s, i, spacing, base, 0, 0, paths)
        first = table.onward_start[row]
        row = int(table.onward[first]) if table.onward_start[row + 1] > first else -1
    clear_waypoints(paths, 0, 0, i)
    paths.waypoint_count[0, 0], paths.path_count[0], paths.left_out[0] = i, 1, 0
    for path in range(1, paths.heading.shape[1]):
        paths.waypoint_count[0, path] = 0
        clear_waypoints(paths, 0, path, 0)


@kernel
def _write_curve(
    roads: Roads,
    table: RouteTable,
    world: int,
    control: Floats,
    x: float,
    y: float,
    height: float,
    mask: int,
    spacing: float,
    paths: WaypointPaths,
) -> tuple[int, float]:
    """Write waypoints from a position to a curve's end; return the next one's number and its overhang [m]."""
    base, i = int(roads.lane_base[world]), 0
    stations = stations_of(control)
    station = station_near(control, stations, x, y)[0]
    room = candidates()
    while i < paths.heading.shape[2] and station < stations[-1]:
        x, y, heading = pose_along(control, stations, station)
        lane, s, _, _, _ = place_on_map(roads, table, world, x, y, height, heading, -1, mask, room)
        write_waypoint(roads, base, base + lane, s, (x, y, heading), 0, 0, i, paths)
        station += spacing
        i += 1
    return i, station - stations[-1]
