"""The one path of an agent that its mission's task guides."""

from __future__ import annotations

from smarts.arrays import Floats
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.curves import curve_into, pose_along, station_near, stations_of
from smarts.roads.kernels import candidates, place_on_map
from smarts.roads.lane_ways import row_of
from smarts.roads.waypoints import WaypointPaths, foot, walk_lane
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
    m: int,
    place: tuple[float, float, float],
    lane: int,
    hint: float,
    mask: int,
    spacing: float,
    paths: WaypointPaths,
) -> None:
    """Write the path of an agent that is led as the first of `paths`.

    In a manoeuvre it begins beside the vehicle on the curve and continues along the curve's target lane;
    before, it is the vehicle's own lane. At forks it takes the first branch along the route.

    Args:
        roads: The maps' lanes.
        table: The routes.
        guidance: Guidance of all agents.
        b: Simulation.
        a: Agent.
        m: Map number.
        place: The vehicle's x, y, height [m].
        lane: The vehicle's lane within the map.
        hint: Distance gone along the agent's route [m].
        mask: Bit k is set if lanes of kind k count.
        spacing: Between waypoints [m].
        paths: Written.
    """
    base, i, points = int(roads.lane_base[m]), 0, paths.point[0]
    if guidance.phase[b, a] == _MANOEUVRE:
        lane = int(guidance.lane[b, a])
        control = curve_into(roads, guidance.begin[b, a], base + lane, guidance.s[b, a])
        i, s = _write_curve(roads, table, m, control, place, mask, spacing, points)
        s += guidance.s[b, a]
    else:
        s = foot(roads, base + lane, *place)
    row = row_of(table, m, table.number[b, a], base + lane, base, hint)
    while row >= 0 and i < len(points):
        i, s = walk_lane(roads, table.lane[row], s, i, spacing, points)
        first = table.onward_start[row]
        row = int(table.onward[first]) if table.onward_start[row + 1] > first else -1
    paths.length[0] = i


@kernel
def _write_curve(
    roads: Roads,
    table: RouteTable,
    m: int,
    control: Floats,
    place: tuple[float, float, float],
    mask: int,
    spacing: float,
    points: Floats,
) -> tuple[int, float]:
    """Write waypoints from a position to a curve's end; return the next one's number and its overhang [m]."""
    i, stations, room = 0, stations_of(control), candidates()
    station = station_near(control, stations, place[0], place[1])[0]
    while i < len(points) and station < stations[-1]:
        x, y, heading = pose_along(control, stations, station)
        lane, s, _, _, _ = place_on_map(roads, table, m, x, y, place[2], heading, -1, mask, room)
        points[i, 0], points[i, 1], points[i, 2] = x, y, heading
        points[i, 3], points[i, 4] = roads.lane_base[m] + lane, s
        station += spacing
        i += 1
    return i, station - stations[-1]
