"""Draws scenarios with matplotlib, without a display.

Each `draw_*` function adds one layer to axes in map coordinates [m]; `scenario_picture` and `scenario_sheet`
combine them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patches import Polygon as Outline
from shapely import Point

from smarts.arrays import Floats
from smarts.envision.bubble_shapes import BUBBLE, bubble_shapes, moved, rings_of
from smarts.envision.route_lines import CAR_LENGTH, place_on_map, pose_on_map, route_line, start_pose
from smarts.envision.vehicle_shapes import CAR, EGOS, footprints, vehicle_shapes
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.sim.moments import Moment
from smarts.sstudio import types as t
from smarts.sstudio.bubble_checks import outline_of
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.episodes import expand
from smarts.types.vehicles import VehicleKind
from smarts.whole_files import written_whole

ASPHALT = "#c6cad1"
JUNCTION = "#bcc1c9"
NOT_FOR_CARS = "#e3e6ec"
LANE_LINE = "#ffffff"
LEFT_EDGE = "#d9a400"
FLOW = "#4c78a8"
STOP = "#2ca02c"
BUS = "#1b7f5c"
TRUCK = "#4d4d4d"
CYCLE = "#0f9bb5"
PEDESTRIAN = "#7b3fa0"
COLOURS = {
    VehicleKind.BUS: BUS,
    VehicleKind.COACH: BUS,
    VehicleKind.TRUCK: TRUCK,
    VehicleKind.TRAILER: TRUCK,
    VehicleKind.MOTORCYCLE: CYCLE,
    VehicleKind.BICYCLE: CYCLE,
    VehicleKind.PEDESTRIAN: PEDESTRIAN,
}
EGO_SIZE = (CAR_LENGTH, 2.0)
MARGIN = 12.0
"""Margin around the missions' routes on a sheet [m]."""
FLATTEST, MOST_UPRIGHT = 0.12, 0.5
"""Minimum and maximum of height / width of a scenario on a sheet."""

Picture = tuple[BuiltScenario, str | None, Moment]
"""A scenario, the name of its traffic variation, and the vehicles to draw."""


def scenario_picture(picture: Picture, out: Path, *, edges: bool = False) -> None:
    """Draw one scenario, with `edges` also the ids of its roads, to a file; the suffix is the format."""
    built, traffic, _ = picture
    figure = Figure(figsize=(12, 12 * _aspect(built.roads()) + 1.0), layout="constrained")
    axes = figure.add_subplot()
    _draw_scenario(axes, picture, edges=edges)
    axes.set_title(f"{built.name}, {traffic or 'no traffic'}", loc="left", parse_math=False)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    figure.legend(handles=_legend(), loc="outside lower center", ncols=7, frameon=False)
    _write(figure, out, 150)


def scenario_sheet(pictures: Sequence[Picture], out: Path, *, edges: bool = False) -> None:
    """Draw several scenarios in two columns to one file, each cropped to its missions' routes."""
    columns = 2
    windows = [_mission_window(built) for built, _, _ in pictures]
    aspects = [height / width for _, _, width, height in windows]
    rows = [max(aspects[first : first + columns]) for first in range(0, len(aspects), columns)]
    width = 15.0 / columns
    figure = Figure(figsize=(15.0, sum(rows) * width + 0.3 * len(rows) + 0.5), layout="constrained")
    grid = figure.subplots(len(rows), columns, squeeze=False, height_ratios=rows)
    for axes, picture, (x, y, window_width, window_height) in zip(grid.flat, pictures, windows, strict=False):
        _draw_scenario(axes, picture, edges=edges)
        axes.set_xlim(x - window_width / 2, x + window_width / 2)
        axes.set_ylim(y - window_height / 2, y + window_height / 2)
        axes.set_title(picture[0].name, fontsize=11, parse_math=False)
    for axes in figure.axes:
        axes.set_axis_off()
    figure.legend(handles=_legend(), loc="outside lower center", ncols=7, frameon=False)
    _write(figure, out, 100)


def draw_roads(axes: Axes, roads: LaneGraph) -> None:
    """Draw junctions and lanes, dashed lines between lanes, and a yellow line on each road's left edge."""
    outlines = [roads.junction_outline(junction) for junction in range(len(roads.junction_ids))]
    areas = [outline for outline in outlines if len(outline) > 2]
    axes.add_collection(PolyCollection(areas, facecolors=JUNCTION, edgecolors="none", zorder=0))
    lanes = range(len(roads.lane_ids))
    colours = [ASPHALT if roads.kind[lane] == LaneKind.CAR else NOT_FOR_CARS for lane in lanes]
    strips = [_strip(roads, lane) for lane in lanes]
    axes.add_collection(PolyCollection(strips, facecolors=colours, edgecolors="none", zorder=1))
    between, left_edges = (
        [_beside(roads, lane, 0.5) for lane in np.flatnonzero(~roads.is_internal & selected).tolist()]
        for selected in (roads.left >= 0, roads.left < 0)
    )
    dashes = (0, (5, 5))
    axes.add_collection(
        LineCollection(between, colors=LANE_LINE, linewidths=0.7, linestyles=[dashes], zorder=2)
    )
    axes.add_collection(LineCollection(left_edges, colors=LEFT_EDGE, linewidths=0.6, zorder=2))


def draw_edge_ids(axes: Axes, roads: LaneGraph) -> None:
    """Write the id of each road edge beside its middle, on the right, along its direction."""
    for edge in np.flatnonzero(~roads.edge_is_internal).tolist():
        lane = roads.edge_lanes(edge)[0]
        x, y, heading = roads.pose_at(lane, float(roads.length[lane]) / 2, -float(roads.width[lane]))
        upright = (np.degrees(heading) + 90.0) % 180.0 - 90.0
        style = {"fontsize": 6, "ha": "center", "va": "center", "rotation": upright, "clip_on": True}
        axes.text(x, y, roads.edge_ids[edge], zorder=10, parse_math=False, **style)


def draw_flows(axes: Axes, roads: LaneGraph, traffic: t.Traffic) -> None:
    """Draw each flow's route as a line with an arrow head at its end, and the flow's stops."""
    for flow in traffic.flows:
        if isinstance(flow.route, t.Route):
            line = route_line(roads, flow.route)
            axes.plot(*line.T, color=FLOW, linewidth=0.8, alpha=0.5, zorder=3)
            _arrow_head(axes, line, FLOW)
        for stop in flow.stops:
            lane, end = place_on_map(roads, (stop.road_id, stop.lane_index, stop.offset))
            kerb = -0.5 * roads.width[lane]
            ends = [roads.pose_at(lane, s, kerb)[:2] for s in (max(end - stop.length, 0.0), end)]
            axes.plot(*zip(*ends, strict=True), color=STOP, linewidth=3, solid_capstyle="butt", zorder=3)


def draw_missions(
    axes: Axes,
    roads: LaneGraph,
    missions: Iterable[t.AnyMission | t.DrawnMission],
    entered: Sequence[int] = (),
) -> None:
    """Draw each mission's route as a line and its goal as a ring; random missions are skipped.

    An ego that has not entered is drawn as an empty box at its start.

    Args:
        axes: The axes to draw on.
        roads: The map.
        missions: The egos' missions.
        entered: Numbers of the egos that have entered.
    """
    for number, mission in enumerate(expand(tuple(missions))):
        start = start_pose(roads, mission)
        if start is None:
            continue
        colour = EGOS[number % len(EGOS)]
        if number not in entered:
            (corners,) = footprints(*np.array([*start, *EGO_SIZE])[:, None])
            axes.add_patch(Outline(corners, fill=False, edgecolor=colour, lw=0.8, zorder=8))
        route = None if isinstance(mission, t.EndlessMission) else mission.route
        if isinstance(route, t.Route):
            goal = pose_on_map(roads, route.end)[:2]
            axes.plot(*route_line(roads, route).T, color=colour, linewidth=1.8, alpha=0.75, zorder=4)
            axes.plot(*goal, marker="o", markersize=9, mfc="none", mec=colour, mew=1.8, zorder=9)


def draw_bubbles(axes: Axes, roads: LaneGraph, bubbles: Iterable[t.Bubble], moment: Moment) -> None:
    """Draw each bubble's zone, its margin as a dashed line, and its name.

    A bubble that travels has an arrow; it is drawn where it follows its vehicle, or as in the scenario's file
    if that vehicle is not there.
    """
    for bubble in bubbles:
        area, with_margin = outline_of(bubble, roads)
        zone, margin = rings_of(area), rings_of(with_margin)
        heading = None
        if bubble.follow_offset is not None:
            x, y, heading = _followed(bubble, moment, area.centroid)
            turn = heading - math.pi / 2
            offset = np.subtract((area.centroid.x, area.centroid.y), bubble.follow_offset)
            zone, margin = (
                [moved(ring - offset, (x, y, turn)) for ring in rings] for rings in (zone, margin)
            )
        for shape in bubble_shapes(zone, margin, name=bubble.id, heading=heading):
            axes.add_artist(shape)


def _followed(bubble: t.Bubble, moment: Moment, centre: Point) -> tuple[float, float, float]:
    """Return the pose of the vehicle that a bubble follows; without it, one at which the bubble stays."""
    slot = moment.names.get(bubble.follow_actor_id or bubble.follow_vehicle_id or "")
    if slot is None:
        right, ahead = bubble.follow_offset or (0.0, 0.0)
        return centre.x - right, centre.y - ahead, math.pi / 2
    x, y = moment.states.position[slot].tolist()
    return x, y, float(moment.states.heading[slot])


def draw_vehicles(axes: Axes, moment: Moment) -> None:
    """Draw the footprint of every vehicle with a light bar across its front; each ego has its colour."""
    states = moment.states
    egos = {slot: EGOS[number % len(EGOS)] for number, slot in enumerate(moment.egos)}
    rows = np.flatnonzero(states.alive)
    colours = [egos.get(row, COLOURS.get(VehicleKind(states.kind[row]), CAR)) for row in rows.tolist()]
    x, y = states.position[rows].T
    places = x, y, states.heading[rows], states.length[rows], states.width[rows]
    for shapes in vehicle_shapes(*places, colours=colours, edge_width=0.3):
        axes.add_collection(shapes)


def _draw_scenario(axes: Axes, picture: Picture, *, edges: bool) -> None:
    built, traffic, moment = picture
    roads = built.roads()
    draw_roads(axes, roads)
    if edges:
        draw_edge_ids(axes, roads)
    if traffic is not None and built.scenario.traffic:
        draw_flows(axes, roads, built.scenario.traffic[traffic])
    draw_bubbles(axes, roads, built.scenario.bubbles or (), moment)
    entered = [number for number, slot in enumerate(moment.egos) if slot >= 0]
    draw_missions(axes, roads, built.scenario.ego_missions or (), entered)
    draw_vehicles(axes, moment)
    axes.set_aspect("equal")
    axes.autoscale_view()


def _mission_window(built: BuiltScenario) -> tuple[float, float, float, float]:
    """Return x and y of the centre, width and height [m] of a window on the missions' routes."""
    roads = built.roads()
    missions = expand(built.scenario.ego_missions or ())
    routes = [mission.route for mission in missions if not isinstance(mission, t.EndlessMission)]
    lines = [route_line(roads, route) for route in routes if isinstance(route, t.Route)]
    points = np.concatenate(lines) if lines else roads.point_xy
    low, high = points.min(0) - MARGIN, points.max(0) + MARGIN
    (x, y), (width, height) = (low + high) / 2, high - low
    width = max(width, height / MOST_UPRIGHT)
    return float(x), float(y), float(width), float(max(height, width * FLATTEST))


def _legend() -> list[Patch]:
    """Return the entries of the legend."""
    return [
        Patch(facecolor=EGOS[0], label="ego, its route and goal"),
        Patch(facecolor=CAR, label="car"),
        Patch(facecolor=BUS, label="bus"),
        Patch(facecolor=TRUCK, label="truck"),
        Patch(facecolor=FLOW, alpha=0.5, label="flow of traffic"),
        Patch(facecolor=STOP, label="bus stop"),
        Patch(facecolor=BUBBLE, alpha=0.4, label="bubble"),
    ]


def _strip(roads: LaneGraph, lane: int) -> Floats:
    """Return the outline of a lane [m], shape (P, 2)."""
    return np.concatenate([_beside(roads, lane, 0.5), _beside(roads, lane, -0.5)[::-1]])


def _beside(roads: LaneGraph, lane: int, widths: float) -> Floats:
    """Return the line `widths` lane widths to the left of a lane's centreline [m], shape (P, 2)."""
    rows = slice(roads.point_start[lane], roads.point_start[lane + 1])
    heading = roads.point_heading[rows]
    left = np.stack([-np.sin(heading), np.cos(heading)], -1)
    return roads.point_xy[rows] + widths * roads.width[lane] * left


def _arrow_head(axes: Axes, line: Floats, colour: str) -> None:
    if len(line) > 2:
        style = {"arrowstyle": "-|>", "color": colour, "lw": 0}
        axes.annotate("", xy=tuple(line[-1]), xytext=tuple(line[-3]), arrowprops=style, zorder=3)


def _aspect(roads: LaneGraph) -> float:
    width, height = np.ptp(roads.point_xy, axis=0) + 10.0
    return float(np.clip(height / width, 0.2, 1.0))


def _write(figure: Figure, out: Path, dpi: int) -> None:
    FigureCanvasAgg(figure)
    with written_whole(out) as partial:
        figure.savefig(partial, dpi=dpi, format=out.suffix.lstrip(".").lower())
