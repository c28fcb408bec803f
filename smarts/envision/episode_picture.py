"""Draws recorded episodes from above, without a display."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from shapely import Polygon, shortest_line

from smarts.arrays import Floats, Longs
from smarts.envision.episode_bubbles import EpisodeBubbles
from smarts.envision.episode_legend import (
    LEGEND_ENTRY,
    count_line,
    group_colour,
    holder_colour,
    legend,
    vehicle_colour,
)
from smarts.envision.episode_owners import EpisodeOwners
from smarts.envision.labels import TextMeasure, place_labels
from smarts.envision.scenario_picture import EGOS, draw_roads
from smarts.envision.vehicle_shapes import air_lock_stripes, footprints, leaving_hatch, vehicle_shapes
from smarts.sim.episode_files import RecordedEpisode
from smarts.types.events import Outcome
from smarts.types.mission import GoalKind
from smarts.types.traffic import Signal
from smarts.types.vehicles import Owner

Ints = Longs
Image = NDArray[np.uint8]
"""Red, green, blue, shape (height, width, 3)."""

MARGIN = 20.0
"""Margin around the agents' paths [m]."""
NARROWEST = 60.0
"""Minimum width and height of the picture [m]."""
TRAIL = 3.0
"""Duration of the trail behind an agent [s]."""
OUTCOME_SHOWN = 4.0
"""How long an agent's outcome is shown at its last position [s]; the last picture shows all outcomes."""
COLLISION = {"marker": (10, 1, 0), "ms": 17, "mfc": "#ffdd33", "mec": "#c00000", "mew": 1.2}
"""The star at the contact point of two vehicles."""
TITLE, LINE = 24, 20
"""Heights of the title and of each row of agents below it [pixels]."""
PADDING = 4
"""Padding of a label's frame [pixels]."""

PLACE = ("x", "y", "heading", "length", "width")
"""Columns of a footprint."""
LIGHTS = {Signal.STOP: "#d62728", Signal.CAUTION: "#ffbf00", Signal.GO: "#2ca02c"}
DOTS_PER_INCH = 100
PIXELS = 900


class EpisodePicture:
    """Draws any step of one episode; roads are drawn once.

    Each ego has a number, that of its row in the table `agents`, a colour, a trail, a ring at its goal, and a
    line of text above the map. A cross marks its last position, or a star if it collided, with its outcome
    beside it for `OUTCOME_SHOWN`. Traffic lights are bars at the ends of their lanes.

    Vehicles of social agents are orange; a line for each policy says how many it has. Vehicles of traffic are
    blue, with stripes while an agent observes them in the air-lock of a bubble. Vehicles that are to go back
    to traffic are hatched. Zones of bubbles are shaded, their margins have dashed lines.

    Args:
        episode: The recorded episode.
        pixels: Width of the picture; the height follows from the map [pixels].
    """

    def __init__(self, episode: RecordedEpisode, *, pixels: int = PIXELS) -> None:
        self.episode = episode
        self.dt = float(episode.facts["dt"])
        self.steps = int(episode.facts["steps"])
        agents = [{**agent, "number": n} for n, agent in enumerate(_rows(episode.table("agents")))]
        self._owners, self._bubbles = EpisodeOwners(episode), EpisodeBubbles(episode)
        self._egos, self._others = agents[: self._owners.egos], agents[self._owners.egos :]
        self._vehicles = episode.table("vehicles")
        self._first = np.searchsorted(self._vehicles["step"], np.arange(self.steps + 2))
        self._roads = episode.roads()
        self._label_size = TextMeasure(8, "normal", DOTS_PER_INCH)
        self._columns = self._header_columns(pixels)
        lines = math.ceil(len(self._egos) / self._columns) + len(self._owners.groups)
        self._legend = legend(self._owners, bool(self._bubbles.names))
        self._legend_columns = max(1, pixels // LEGEND_ENTRY)
        self._header = TITLE + LINE * (lines + math.ceil(len(self._legend) / self._legend_columns))
        self._figure, self._axes = self._road_figure(pixels)
        self._canvas = FigureCanvasAgg(self._figure)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self._figure.bbox)
        self._artists: list[Any] = []

    def images(self, steps: Sequence[int]) -> Iterator[Image]:
        """Yield the pictures of `steps`, each a copy, shape (height, width, 3)."""
        for step in steps:
            yield self.image(step)

    def image(self, step: int) -> Image:
        """Return the picture of a step, counted from the reset (step 0), shape (height, width, 3)."""
        self._canvas.restore_region(self._background)
        self._artists = []
        for shape in self._bubbles.shapes(step):
            self._axes.add_artist(shape)
            self._artists.append(shape)
        self._draw_lights(step)
        self._draw_trails(step)
        self._draw_vehicles(step)
        self._draw_agents(step)
        self._write_title(step)
        for artist in sorted(self._artists, key=lambda artist: artist.get_zorder()):
            self._figure.draw_artist(artist)
            artist.remove()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _header_columns(self, pixels: int) -> int:
        """Return how many agents' lines fit side by side."""
        measure = TextMeasure(8, "bold", DOTS_PER_INCH)
        longest = max(
            (measure(_longest_line(agent, self.steps * self.dt))[0] for agent in self._egos), default=1
        )
        return max(1, min(len(self._egos), int(pixels * 0.98 // (longest + 12))))

    def _road_figure(self, pixels: int) -> tuple[Figure, Any]:
        """Return a figure with the roads and goals in the window, and its axes."""
        low, high = self._window()
        width, height = high - low
        # A header above the map for texts; even numbers of pixels for video.
        size = 2 * np.round(np.array([pixels, pixels * height / width + self._header]) / 2)
        figure = Figure(figsize=tuple(size / DOTS_PER_INCH), dpi=DOTS_PER_INCH, facecolor="white")
        axes = figure.add_axes((0.0, 0.0, 1.0, float(1.0 - self._header / size[1])))
        draw_roads(axes, self._roads)
        if self._legend:
            place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0 - self._header / size[1])}
            style = {"ncols": self._legend_columns, "fontsize": 8, "frameon": False, "borderpad": 0.2}
            figure.legend(handles=self._legend, **place, **style)
        for agent in self._egos:
            if goal := self._goal_of(agent):
                axes.plot(*goal, marker="o", ms=10, mfc="none", mec=_colour(agent), mew=2, zorder=9)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_axis_off()
        return figure, axes

    def _goal_of(self, agent: dict[str, Any]) -> tuple[float, float] | None:
        """Return where an agent's goal is, None without one."""
        if agent["goal"] == GoalKind.LANE_LINE:
            return self._roads.pose_at(int(agent["goal_lane"]), float(agent["goal_s"]))[:2]
        at_position = agent["goal"] == GoalKind.POSITION
        return (float(agent["goal_x"]), float(agent["goal_y"])) if at_position else None

    def _present(self, step: int, *columns: str) -> list[NDArray]:
        """Return columns of the vehicles in a step."""
        rows = slice(self._first[step], self._first[step + 1])
        return [self._vehicles[name][rows] for name in columns]

    def _window(self) -> tuple[Floats, Floats]:
        """Return the lower left and upper right corners [m] of a window on ways, goals and bubbles."""
        points = [np.array([[agent["start_x"], agent["start_y"]]]) for agent in self._egos]
        points += [np.stack(self._path(agent, 0, self.steps), -1) for agent in self._egos]
        points += [np.array([goal]) for agent in self._egos if (goal := self._goal_of(agent))]
        driven = self._vehicles["owner"] == Owner.AGENT
        points.append(np.stack([self._vehicles[name][driven] for name in ("x", "y")], -1))
        points.append(self._bubbles.corners())
        shown = np.concatenate(points)
        shown = shown if len(shown) else self._roads.point_xy
        low, high = shown.min(0) - MARGIN, shown.max(0) + MARGIN
        missing = np.maximum(0.0, NARROWEST - (high - low)) / 2
        return low - missing, high + missing

    def _path(self, agent: dict[str, Any], first: int, last: int) -> tuple[Floats, Floats]:
        """Return x and y of an agent's vehicle [m], shape (T,), from step `first` to `last` or its end."""
        vehicles = self._vehicles
        last = min(last, int(agent["end_step"]))
        rows = slice(self._first[min(first, self.steps + 1)], self._first[max(0, last + 1)])
        own = (vehicles["slot"][rows] == agent["slot"]) & (
            vehicles["generation"][rows] == agent["generation"]
        )
        return vehicles["x"][rows][own], vehicles["y"][rows][own]

    def _draw_lights(self, step: int) -> None:
        signals = self.episode.table("signals")
        shown = {
            int(lane): Signal(int(light))
            for when, lane, light in zip(signals["step"], signals["lane"], signals["signal"], strict=True)
            if when <= step
        }
        bars, colours = [], []
        for lane, light in shown.items():
            if light in LIGHTS:
                half, end = self._roads.width[lane] / 2, float(self._roads.length[lane])
                bars.append([self._roads.pose_at(lane, end, t)[:2] for t in (-half, half)])
                colours.append(LIGHTS[light])
        self._add(LineCollection(bars, colors=colours, linewidths=3, zorder=3))

    def _draw_trails(self, step: int) -> None:
        first = step - round(TRAIL / self.dt)
        for agent in self._egos:
            if agent["entry_step"] <= step <= agent["end_step"]:
                way = np.stack(self._path(agent, max(first, 0), step), -1)
                self._add(LineCollection([way], colors=_colour(agent), linewidths=2.5, alpha=0.5, zorder=5))

    def _draw_vehicles(self, step: int) -> None:
        slots, generations = self._present(step, "slot", "generation")
        now = self._owners.holders(step)
        holders = [now.get(each) for each in zip(slots.tolist(), generations.tolist(), strict=True)]
        places = self._present(step, *PLACE)
        for shapes in vehicle_shapes(*places, colours=[*map(vehicle_colour, holders)], edge_width=0.6):
            self._add(shapes)
        observed, leaving = (
            np.array([holder is not None and getattr(holder, name) for holder in holders], bool)
            for name in ("observes", "leaves")
        )
        if observed.any():
            colours = [holder_colour(holder) for holder in holders if holder and holder.observes]
            self._add(air_lock_stripes(*(column[observed] for column in places), colours=colours))
        if leaving.any():
            self._add(leaving_hatch(*(column[leaving] for column in places)))

    def _draw_agents(self, step: int) -> None:
        """Mark the egos' last positions, label each ego with its number and outcome, mark collisions."""
        labelled = []
        for agent in self._egos:
            since = step - int(agent["end_step"])
            if agent["entry_step"] < 0 or step < agent["entry_step"]:
                continue
            x, y = (float(column[-1]) for column in self._path(agent, 0, step))
            has_ended = since >= 0 and agent["outcome"] != Outcome.NONE
            if has_ended:
                self._mark_end(agent, x, y, is_gone=since > 0)
            if since * self.dt <= OUTCOME_SHOWN or step == self.steps:
                text = _outcome_name(agent) if has_ended else ""
                labelled.append((agent, f"{agent['number']} {text}".strip(), (x, y)))
        self._write_labels(step, labelled)
        for agent in self._others:
            since = (step - int(agent["end_step"])) * self.dt
            if agent["outcome"] == Outcome.COLLISION and 0 <= since <= OUTCOME_SHOWN:
                x, y = (float(column[-1]) for column in self._path(agent, 0, step))
                self._mark_end(agent, x, y, is_gone=False)

    def _mark_end(self, agent: dict[str, Any], x: float, y: float, *, is_gone: bool) -> None:
        if agent["outcome"] == Outcome.COLLISION:
            self._artists += self._axes.plot(*self._contact_point(agent, x, y), zorder=9, **COLLISION)
        elif is_gone:
            cross = self._axes.plot(x, y, marker="x", ms=11, mew=2.5, color=_colour(agent), zorder=9)
            self._artists += cross

    def _contact_point(self, agent: dict[str, Any], x: float, y: float) -> tuple[float, float]:
        """Return where an agent's vehicle touched its partner [m], or (x, y) if a vehicle is not recorded."""
        step, boxes = int(agent["end_step"]), []
        present = self._present(step, *PLACE)
        slots, generations = self._present(step, "slot", "generation")
        for slot, generation in (
            (agent["slot"], agent["generation"]),
            (agent["partner_slot"], agent["partner_generation"]),
        ):
            found = (slots == slot) & (generations == generation)
            boxes += list(footprints(*(column[found] for column in present)))
        if len(boxes) < 2:
            return x, y
        one, other = map(Polygon, boxes)
        place = one.intersection(other) if one.intersects(other) else shortest_line(one, other)
        return place.centroid.x, place.centroid.y

    def _write_labels(
        self, step: int, labelled: Sequence[tuple[dict[str, Any], str, tuple[float, float]]]
    ) -> None:
        """Write labels beside positions on the map, without overlap with each other and with few vehicles.

        Args:
            step: The step whose vehicles are drawn.
            labelled: Agent, text, and position [m] of each label.
        """
        to_pixels = self._axes.transData.transform
        width, height = self._figure.bbox.width, self._figure.bbox.height
        boxes = footprints(*self._present(step, *PLACE))
        corners = to_pixels(boxes.reshape(-1, 2)).reshape(-1, 4, 2)
        sizes = [self._label_size(text) for _, text, _ in labelled]
        centres = place_labels(
            [tuple(to_pixels(place)) for _, _, place in labelled],
            [(w + 2 * PADDING, h + 2 * PADDING) for w, h in sizes],
            np.concatenate([corners.min(1), corners.max(1)], -1),
            (0.0, 0.0, width, height - self._header),
        )
        for (agent, text, place), centre in zip(labelled, centres, strict=True):
            style = {"boxstyle": "round,pad=0.25", "fc": "white", "ec": _colour(agent), "alpha": 0.9}
            label = self._axes.annotate(
                text,
                place,
                xytext=centre,
                textcoords="figure pixels",
                ha="center",
                va="center",
                fontsize=8,
                parse_math=False,
                color=_colour(agent),
                bbox=style,
                arrowprops={"arrowstyle": "-", "color": _colour(agent), "lw": 0.8},
                zorder=10,
            )
            self._artists.append(label)

    def _write_title(self, step: int) -> None:
        facts = self.episode.facts
        title = f"{facts['scenario']}, {facts['traffic'] or 'no traffic'}   {step * self.dt:.1f} s"
        height = self._figure.bbox.height
        style = {"fontsize": 10, "va": "center", "parse_math": False}
        self._artists.append(self._figure.text(0.01, 1 - 13 / height, title, **style))
        for place, agent in enumerate(self._egos):
            row, column = divmod(place, self._columns)
            line = f"{agent['number']} {agent['name']}: {self._status(agent, step)}"
            self._write_line(row, 0.98 * column / self._columns, line, _colour(agent))
        rows = math.ceil(len(self._egos) / self._columns)
        holders = self._owners.holders(step).values()
        for place, (group, name) in enumerate(self._owners.groups.items()):
            line = count_line(name, [each for each in holders if each.policy == group])
            self._write_line(rows + place, 0.0, line, group_colour(group))

    def _write_line(self, row: int, x: float, line: str, colour: str) -> None:
        """Write a line below the title; x is a fraction of the width."""
        y = 1 - (TITLE + LINE * row + 9) / self._figure.bbox.height
        style = {"fontsize": 8, "va": "center", "color": colour, "weight": "bold", "parse_math": False}
        self._artists.append(self._figure.text(0.01 + x, y, line, **style))

    def _status(self, agent: dict[str, Any], step: int) -> str:
        """Return an ego's status: its outcome, or its speed while it has its vehicle."""
        if agent["entry_step"] < 0 or step < agent["entry_step"]:
            return "waits"
        if step >= agent["end_step"] and agent["outcome"] != Outcome.NONE:
            return f"{_outcome_name(agent)} at {agent['end_step'] * self.dt:.1f} s"
        if step > agent["end_step"]:
            return "gone"
        slots, generations, speeds = self._present(step, "slot", "generation", "speed")
        speed = speeds[(slots == agent["slot"]) & (generations == agent["generation"])]
        holder = self._owners.holders(step).get((agent["slot"], agent["generation"]))
        watches = holder is not None and holder.observes
        return ("watches, " if watches else "") + (f"{speed[0]:.1f} m/s" if len(speed) else "")

    def _add(self, collection: Any) -> None:
        self._axes.add_collection(collection, autolim=False)
        self._artists.append(collection)


def _rows(table: Any) -> list[dict[str, Any]]:
    return [dict(zip(table, values, strict=True)) for values in zip(*table.values(), strict=True)]


def _longest_line(agent: dict[str, Any], seconds: float) -> str:
    """Return the longest line that may be written about an agent above the map."""
    ending = f"{_outcome_name(agent)} at {seconds:.1f} s"
    return f"{agent['number']} {agent['name']}: {max(ending, 'watches, 88.8 m/s', key=len)}"


def _colour(agent: dict[str, Any]) -> str:
    return EGOS[agent["number"] % len(EGOS)]


def _outcome_name(agent: dict[str, Any]) -> str:
    return Outcome(int(agent["outcome"])).name.lower().replace("_", " ")
