"""Shapes of vehicles and lights in pictures, and the pictures of roads that they are drawn on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.roads.lane_graph import LaneGraph
from smarts.types.traffic import Signal

Image = NDArray[np.uint8]
"""Red, green, blue, shape (height, width, 3)."""

DOTS_PER_INCH = 100
EGOS = ("#d62728", "#e0627d", "#9e2a6b", "#8c564b")
CAR = "#2c5f8a"
SOCIAL = "#ff7f0e"
"""Colours of the vehicles of egos, of traffic and of social agents."""
LIGHTS = {Signal.STOP: "#d62728", Signal.CAUTION: "#ffbf00", Signal.GO: "#2ca02c"}
STRIPES = (-0.38, -0.2, -0.02)
"""Places of the stripes across a vehicle in an air-lock, in lengths from its centre."""
STRIPE = 0.09
"""Width of a stripe, in lengths of the vehicle."""
HATCH = "#1a1a1a"


def vehicle_shapes(
    x: Floats,
    y: Floats,
    heading: Floats,
    length: Floats,
    width: Floats,
    *,
    colours: Sequence[str],
    edge_width: float,
) -> tuple[PolyCollection, PolyCollection]:
    """Return the footprints of V vehicles, and light bars across their fronts."""
    nose = 0.3 * length
    front = x + nose * np.cos(heading), y + nose * np.sin(heading)
    boxes = list(footprints(x, y, heading, length, width))
    noses = list(footprints(*front, heading, 0.16 * length, 0.8 * width))
    return (
        PolyCollection(boxes, facecolors=colours, edgecolors="k", linewidths=edge_width, zorder=6),
        PolyCollection(noses, facecolors="#e8eef5", edgecolors="none", zorder=7),
    )


def footprints(x: Floats, y: Floats, heading: Floats, length: Floats, width: Floats) -> Floats:
    """Return the corners of V footprints, shape (V, 4, 2)."""
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1) * (length / 2)[:, None]
    aside = np.stack([-np.sin(heading), np.cos(heading)], -1) * (width / 2)[:, None]
    centre = np.stack([x, y], -1)
    return centre[:, None] + np.stack([ahead + aside, aside - ahead, -ahead - aside, ahead - aside], 1)


def air_lock_stripes(
    x: Floats, y: Floats, heading: Floats, length: Floats, width: Floats, *, colours: Sequence[str]
) -> PolyCollection:
    """Return stripes across V vehicles that agents observe before they drive."""
    stripes: list[Floats] = []
    for place in STRIPES:
        along = place * length
        centre = x + along * np.cos(heading), y + along * np.sin(heading)
        stripes += [*footprints(*centre, heading, STRIPE * length, width)]
    return PolyCollection(stripes, facecolors=[*colours] * len(STRIPES), edgecolors="none", zorder=7)


def leaving_hatch(x: Floats, y: Floats, heading: Floats, length: Floats, width: Floats) -> LineCollection:
    """Return slanted lines across V vehicles that are to go back to traffic."""
    lines: list[Floats] = []
    for place in STRIPES:
        # From corner to corner of a rectangle that is as long as the vehicle is wide.
        middle = place * length
        centre = x + middle * np.cos(heading), y + middle * np.sin(heading)
        lines += [*footprints(*centre, heading, np.minimum(width, 0.2 * length), width)[:, ::2]]
    return LineCollection(lines, colors=HATCH, linewidths=1.4, zorder=7)


class Canvas:
    """Draws artists over what a figure has already, which is drawn once."""

    def __init__(self, figure: Figure) -> None:
        self._figure, self._canvas = figure, FigureCanvasAgg(figure)
        self._canvas.draw()
        self._background: Any = self._canvas.copy_from_bbox(figure.bbox)

    def image(self, artists: Iterable[Any]) -> Image:
        """Return a picture with some artists, which are removed from the figure afterwards."""
        self._canvas.restore_region(self._background)
        for artist in sorted(artists, key=lambda each: each.get_zorder()):
            self._figure.draw_artist(artist)
            artist.remove()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


def driven_vehicles(
    axes: Axes, places: Sequence[Floats], colours: Sequence[str], observes: Bools, leaves: Bools
) -> list[Any]:
    """Draw V vehicles by what drives them; return the artists.

    Args:
        axes: On which they are drawn.
        places: x, y, heading, length and width, shape (V,) each.
        colours: Colour of each vehicle's agent, or of traffic.
        observes: Whether the agent observes in an air-lock while traffic drives, shape (V,).
        leaves: Whether the vehicle is to go back to traffic, shape (V,).
    """
    drivers = [CAR if observed else colour for observed, colour in zip(observes, colours, strict=True)]
    shapes: list[Any] = [*vehicle_shapes(*places, colours=drivers, edge_width=0.6)]
    if observes.any():
        chosen = [colour for observed, colour in zip(observes, colours, strict=True) if observed]
        shapes.append(air_lock_stripes(*(each[observes] for each in places), colours=chosen))
    if leaves.any():
        shapes.append(leaving_hatch(*(each[leaves] for each in places)))
    return [axes.add_collection(shape, autolim=False) for shape in shapes]


def light_bars(axes: Axes, roads: LaneGraph, lights: Iterable[tuple[int, int]]) -> Any:
    """Draw traffic lights as bars at the ends of their lanes, each given by lane and `Signal`."""
    bars, colours = [], []
    for lane, light in lights:
        if light in LIGHTS:
            half, end = float(roads.width[lane]) / 2, float(roads.length[lane])
            bars.append([roads.pose_at(lane, end, t)[:2] for t in (-half, half)])
            colours.append(LIGHTS[Signal(light)])
    return axes.add_collection(LineCollection(bars, colors=colours, linewidths=3, zorder=3), autolim=False)


def label_beside(axes: Axes, text: str, place: tuple[float, float], colour: str) -> Any:
    """Write a text beside a place on the map."""
    return axes.annotate(
        text,
        place,
        xytext=(9, 9),
        textcoords="offset pixels",
        fontsize=8,
        weight="bold",
        color=colour,
        clip_on=True,
        zorder=10,
        parse_math=False,
        bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75},
    )
