"""Pictures from above: roads, and over them what is there at one time."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.envision.animation import Image
from smarts.envision.scenario_picture import draw_roads
from smarts.envision.vehicle_shapes import CAR, EGOS, SOCIAL, air_lock_stripes, leaving_hatch, vehicle_shapes
from smarts.roads.lane_graph import LaneGraph
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.mission import GoalKind
from smarts.types.traffic import Signal

DOTS_PER_INCH = 100
LIGHTS = {Signal.STOP: "#d62728", Signal.CAUTION: "#ffbf00", Signal.GO: "#2ca02c"}
RING = {"marker": "o", "ms": 10, "mfc": "none", "mew": 2, "zorder": 9}
"""The ring at a goal."""
_BOX = {"fc": "white", "ec": "none", "alpha": 0.75}
_NO_DRIVER = UNSET, UNSET, UNSET

Place = tuple[float, float]
Columns = Mapping[str, NDArray]


class Shown(NamedTuple):
    """What is there at one time, besides roads."""

    title: str
    vehicles: Columns
    """`slot`, `generation`, `x`, `y`, `heading`, `length` and `width` of vehicles, as recorded."""
    states: Columns
    """`slot`, `generation`, `agent_id`, `state` and `release_step` of agents that have vehicles."""
    social: Collection[int]
    """Agent_ids of social agents."""
    lights: Iterable[tuple[int, int]]
    """Lanes, each with its `Signal`."""
    shapes: Iterable[Artist]
    """Further shapes, such as those of bubbles."""
    labels: Iterable[tuple[str, Place, str]]
    """Text, place [m] and colour."""


class TopView:
    """Draws one time after another over roads, which are drawn once.

    Vehicles of egos have colours by their agent_id, those of social agents are orange, those of traffic blue,
    with stripes while an agent observes them in the air-lock of a bubble. Vehicles that are to go back to
    traffic are hatched. Traffic lights are bars at the ends of their lanes.

    Args:
        roads: The map.
        low: Lower left corner of what is shown [m].
        high: Upper right corner [m].
        size: Width and height [pixels].
    """

    def __init__(self, roads: LaneGraph, low: Floats, high: Floats, size: tuple[int, int]) -> None:
        self._roads = roads
        self._figure = Figure(figsize=(size[0] / DOTS_PER_INCH, size[1] / DOTS_PER_INCH), dpi=DOTS_PER_INCH)
        self.axes: Any = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        draw_roads(self.axes, roads)
        self.axes.set_xlim(low[0], high[0])
        self.axes.set_ylim(low[1], high[1])
        self.axes.set_axis_off()
        self._canvas = FigureCanvasAgg(self._figure)
        self._canvas.draw()
        self._background: Any = self._canvas.copy_from_bbox(self._figure.bbox)

    def image(self, shown: Shown) -> Image:
        """Return a picture, shape (height, width, 3)."""
        artists = [self.axes.add_artist(shape) for shape in (*shown.shapes, *self._vehicles(shown))]
        artists.append(self.axes.add_artist(self._lights(shown.lights)))
        style = {"fontsize": 8, "weight": "bold", "clip_on": True, "zorder": 10, "parse_math": False}
        beside = {
            "xytext": (9, 9),
            "textcoords": "offset pixels",
            "bbox": {"boxstyle": "round,pad=0.15", **_BOX},
        }
        for text, place, colour in shown.labels:
            artists.append(self.axes.annotate(text, place, color=colour, **style, **beside))
        corner = {"xytext": (8, -8), "textcoords": "offset pixels", "va": "top", "fontsize": 10, "zorder": 11}
        box = {"bbox": {"boxstyle": "square,pad=0.3", **_BOX}, "parse_math": False}
        artists.append(self.axes.annotate(shown.title, (0, 1), xycoords="axes fraction", **corner, **box))
        self._canvas.restore_region(self._background)
        for artist in sorted(artists, key=lambda each: each.get_zorder()):
            self._figure.draw_artist(artist)
            artist.remove()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _vehicles(self, shown: Shown) -> list[Artist]:
        """Return the shapes of vehicles, by what drives them."""
        vehicles, states = shown.vehicles, shown.states
        names = "slot", "generation", "agent_id", "state", "release_step"
        rows = zip(*(states[name].tolist() for name in names), strict=True)
        driver_of = {(slot, generation): driver for slot, generation, *driver in rows}
        keys = zip(vehicles["slot"].tolist(), vehicles["generation"].tolist(), strict=True)
        drivers = np.array([driver_of.get(key, _NO_DRIVER) for key in keys]).reshape(-1, 3)
        agent_ids, status, release = drivers.T
        observes = status == AgentStatus.SHADOWING
        leaves = (status == AgentStatus.LEAVING) | ((status == AgentStatus.ACTIVE) & (release != UNSET))
        colours = [colour_of(each, shown.social) for each in agent_ids.tolist()]
        drawn = [CAR if observed else colour for observed, colour in zip(observes, colours, strict=True)]
        places = [vehicles[name] for name in ("x", "y", "heading", "length", "width")]
        shapes: list[Artist] = [*vehicle_shapes(*places, colours=drawn, edge_width=0.6)]
        chosen = [colour for observed, colour in zip(observes, colours, strict=True) if observed]
        shapes.append(air_lock_stripes(*(each[observes] for each in places), colours=chosen))
        return [*shapes, leaving_hatch(*(each[leaves] for each in places))]

    def _lights(self, lights: Iterable[tuple[int, int]]) -> LineCollection:
        bars, colours = [], []
        for lane, light in lights:
            if light in LIGHTS:
                half, end = float(self._roads.width[lane]) / 2, float(self._roads.length[lane])
                bars.append([self._roads.pose_at(lane, end, t)[:2] for t in (-half, half)])
                colours.append(LIGHTS[Signal(light)])
        return LineCollection(bars, colors=colours, linewidths=3, zorder=3)


def colour_of(agent_id: int, social: Collection[int]) -> str:
    """Return the colour of an agent's vehicle, of traffic for -1."""
    if agent_id == UNSET:
        return CAR
    return SOCIAL if agent_id in social else EGOS[agent_id % len(EGOS)]


def mark(place: Place, **style: Any) -> Line2D:
    """Return a marker at a place."""
    return Line2D([place[0]], [place[1]], ls="none", **style)


def goal_place(roads: LaneGraph, goal: int, position: Place, lane: int, s: float) -> Place | None:
    """Return where a goal is [m], None without one; the columns of a mission are in the table `agents`."""
    if goal == GoalKind.LANE_LINE:
        return roads.pose_at(lane, s)[:2]
    return position if goal == GoalKind.POSITION else None
