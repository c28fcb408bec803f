"""Draws recorded episodes from above, without a display."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.envision.bubble_shapes import BUBBLE
from smarts.envision.episode_bubbles import EpisodeBubbles
from smarts.envision.scenario_picture import draw_roads
from smarts.envision.vehicle_shapes import (
    CAR,
    DOTS_PER_INCH,
    EGOS,
    HATCH,
    SOCIAL,
    Canvas,
    Image,
    driven_vehicles,
    label_beside,
    light_bars,
)
from smarts.sim.episode_files import RecordedEpisode
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.events import Outcome
from smarts.types.mission import GoalKind
from smarts.types.vehicles import Owner

MARGIN = 20.0
"""Margin around the agents' paths [m]."""
NARROWEST = 60.0
"""Minimum width and height of the picture [m]."""
TRAIL = 3.0
"""Duration of the trail behind an agent [s]."""
OUTCOME_SHOWN = 4.0
"""How long an agent's outcome is shown at its last position [s]; the last picture shows all outcomes."""
COLLISION = {"marker": (10, 1, 0), "ms": 17, "mfc": "#ffdd33", "mec": "#c00000", "mew": 1.2}
"""The star at a vehicle that collided."""
TITLE, LINE = 24, 20
"""Heights of the title and of each line below it [pixels]."""
LINE_WIDTH, LEGEND_ENTRY = 240, 125
"""Widths of an ego's line and of an entry of the legend [pixels]."""

PLACE = ("x", "y", "heading", "length", "width")
"""Columns of a footprint."""
PIXELS = 900

Driver = tuple[int, bool, bool]
"""Column of the agent that has a vehicle, whether it observes while traffic drives, whether it gives back."""


class EpisodePicture:
    """Draws any step of one episode; roads are drawn once.

    Each ego has a number, that of its row in the table `agents`, a colour, a trail, a ring at its goal, and a
    line of text above the map. A cross marks its last position, or a star if it collided, with its outcome
    beside it for `OUTCOME_SHOWN`. Traffic lights are bars at the ends of their lanes.

    Vehicles of social agents are orange; a line says how many there are. Vehicles of traffic are blue, with
    stripes while an agent observes them in the air-lock of a bubble. Vehicles that are to go back to traffic
    are hatched. Zones of bubbles are shaded, their margins have dashed lines.

    Args:
        episode: The recorded episode.
        pixels: Width of the picture; the height follows from the map [pixels].
    """

    def __init__(self, episode: RecordedEpisode, *, pixels: int = PIXELS) -> None:
        self.episode = episode
        self.dt = float(episode.facts["dt"])
        self.steps = int(episode.facts["steps"])
        table = episode.table("agents")
        agents = [{**agent, "number": number} for number, agent in enumerate(_rows(table))]
        is_ego = table["interface"] < 0
        self._social = {*table["agent_id"][~is_ego].tolist()} - {UNSET}
        columns = table["agent_id"][is_ego]
        # Agents that learn in bubbles share columns in turn: they have no lines of their own.
        self._are_in_turn = len(np.unique(columns)) < len(columns)
        egos = 0 if self._are_in_turn else len(columns)
        self._egos, self._others = agents[:egos], agents[egos:]
        self._vehicles, self._states = episode.table("vehicles"), _by_step(episode.table("agent_states"))
        self._first, self._first_state = (
            np.searchsorted(rows["step"], np.arange(self.steps + 2))
            for rows in (self._vehicles, self._states)
        )
        self._bubbles, self._roads = EpisodeBubbles(episode), episode.roads()
        self._columns = max(1, pixels // LINE_WIDTH)
        self._figure, self._axes = self._road_figure(pixels)
        self._canvas = Canvas(self._figure)
        self._artists: list[Any] = []

    def images(self, steps: Sequence[int]) -> Iterator[Image]:
        """Yield the pictures of `steps`, each a copy, shape (height, width, 3)."""
        for step in steps:
            yield self.image(step)

    def image(self, step: int) -> Image:
        """Return the picture of a step, counted from the reset (step 0), shape (height, width, 3)."""
        drivers = self._drivers(step)
        signals = self.episode.table("signals")
        shown = signals["step"] <= step
        lights = dict(zip(signals["lane"][shown].tolist(), signals["signal"][shown].tolist(), strict=True))
        self._artists = [self._axes.add_artist(shape) for shape in self._bubbles.shapes(step)]
        self._artists.append(light_bars(self._axes, self._roads, lights.items()))
        self._draw_trails(step)
        self._draw_vehicles(step, drivers)
        self._draw_agents(step)
        self._write_header(step, drivers)
        return self._canvas.image(self._artists)

    def _road_figure(self, pixels: int) -> tuple[Figure, Any]:
        """Return a figure with the roads and goals in the window, and its axes."""
        low, high = self._window()
        width, height = high - low
        legend, columns = self._legend(), max(1, pixels // LEGEND_ENTRY)
        lines = math.ceil(len(self._egos) / self._columns) + self._are_in_turn + bool(self._social)
        header = TITLE + LINE * (lines + math.ceil(len(legend) / columns))
        # A header above the map for texts; even numbers of pixels for video.
        size = 2 * np.round(np.array([pixels, pixels * height / width + header]) / 2)
        figure = Figure(figsize=tuple(size / DOTS_PER_INCH), dpi=DOTS_PER_INCH, facecolor="white")
        axes = figure.add_axes((0.0, 0.0, 1.0, float(1.0 - header / size[1])))
        draw_roads(axes, self._roads)
        if legend:
            place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0 - header / size[1])}
            style = {"ncols": columns, "fontsize": 8, "frameon": False, "borderpad": 0.2}
            figure.legend(handles=legend, **place, **style)
        for agent in self._egos:
            if goal := self._goal_of(agent):
                axes.plot(*goal, marker="o", ms=10, mfc="none", mec=_colour(agent), mew=2, zorder=9)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_axis_off()
        return figure, axes

    def _legend(self) -> list[Patch]:
        """Return the entries of the legend, none for an episode of egos alone."""
        if not (self._social or self._are_in_turn or self._bubbles.names):
            return []
        return [
            Patch(facecolor=EGOS[0], label="ego"),
            Patch(facecolor=SOCIAL, label="social agent"),
            Patch(facecolor=CAR, label="traffic"),
            Patch(facecolor=CAR, edgecolor=SOCIAL, hatch="|||", label="in the air-lock"),
            Patch(facecolor=SOCIAL, edgecolor=HATCH, hatch="////", label="leaving"),
            Patch(facecolor=BUBBLE, edgecolor=BUBBLE, alpha=0.4, label="bubble"),
        ]

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

    def _drivers(self, step: int) -> dict[tuple[int, int], Driver]:
        """Return the agents that have vehicles in a step, by the vehicles' slots and generations."""
        rows = slice(self._first_state[step], self._first_state[step + 1])
        names = ("slot", "generation", "agent_id", "state", "release_step")
        found = {}
        for slot, generation, agent_id, state, release in zip(
            *(self._states[name][rows].tolist() for name in names), strict=True
        ):
            is_released = release != UNSET and state == AgentStatus.ACTIVE
            leaves = is_released or state == AgentStatus.LEAVING
            found[slot, generation] = agent_id, state == AgentStatus.SHADOWING, leaves
        return found

    def _window(self) -> tuple[Floats, Floats]:
        """Return the lower left and upper right corners [m] of a window on ways, goals and bubbles."""
        points = [np.array([[agent["start_x"], agent["start_y"]]]) for agent in self._egos]
        points += [self._path(agent, 0, self.steps) for agent in self._egos]
        points += [np.array([goal]) for agent in self._egos if (goal := self._goal_of(agent))]
        driven = self._vehicles["owner"] == Owner.AGENT
        points.append(np.stack([self._vehicles[name][driven] for name in ("x", "y")], -1))
        points.append(self._bubbles.corners())
        shown = np.concatenate(points)
        shown = shown if len(shown) else self._roads.point_xy
        low, high = shown.min(0) - MARGIN, shown.max(0) + MARGIN
        missing = np.maximum(0.0, NARROWEST - (high - low)) / 2
        return low - missing, high + missing

    def _path(self, agent: dict[str, Any], first: int, last: int) -> Floats:
        """Return the way of an agent's vehicle [m], shape (T, 2), from step `first` to `last` or its end."""
        vehicles = self._vehicles
        last = min(last, int(agent["end_step"]))
        rows = slice(self._first[min(first, self.steps + 1)], self._first[max(0, last + 1)])
        own = vehicles["slot"][rows] == agent["slot"]
        own &= vehicles["generation"][rows] == agent["generation"]
        return np.stack([vehicles["x"][rows][own], vehicles["y"][rows][own]], -1)

    def _draw_trails(self, step: int) -> None:
        first = max(0, step - round(TRAIL / self.dt))
        for agent in self._egos:
            if agent["entry_step"] <= step <= agent["end_step"]:
                style = {"colors": _colour(agent), "linewidths": 2.5, "alpha": 0.5, "zorder": 5}
                trail = LineCollection([self._path(agent, first, step)], **style)
                self._artists.append(self._axes.add_collection(trail, autolim=False))

    def _draw_vehicles(self, step: int, drivers: dict[tuple[int, int], Driver]) -> None:
        slots, generations = (column.tolist() for column in self._present(step, "slot", "generation"))
        found = [drivers.get(each, (UNSET, False, False)) for each in zip(slots, generations, strict=True)]
        colours = [self._driver_colour(agent_id) for agent_id, _, _ in found]
        observes, leaves = (np.array([each[k] for each in found], np.bool_) for k in (1, 2))
        places = self._present(step, *PLACE)
        self._artists += driven_vehicles(self._axes, places, colours, observes, leaves)

    def _driver_colour(self, agent_id: int) -> str:
        if agent_id == UNSET:
            return CAR
        return SOCIAL if agent_id in self._social else EGOS[agent_id % len(EGOS)]

    def _draw_agents(self, step: int) -> None:
        """Mark the egos' last positions, label each ego with its number and outcome, mark collisions."""
        for agent in [*self._egos, *self._others]:
            is_ego, since = agent["number"] < len(self._egos), step - int(agent["end_step"])
            has_collided = since >= 0 and agent["outcome"] == Outcome.COLLISION
            is_shown = since * self.dt <= OUTCOME_SHOWN or step == self.steps
            if not 0 <= agent["entry_step"] <= step or not (is_ego or (has_collided and is_shown)):
                continue
            x, y = self._path(agent, 0, step)[-1].tolist()
            has_ended = since >= 0 and agent["outcome"] != Outcome.NONE
            if has_collided:
                self._artists += self._axes.plot(x, y, zorder=9, **COLLISION)
            elif has_ended and since > 0:
                cross = {"marker": "x", "ms": 11, "mew": 2.5, "color": _colour(agent), "zorder": 9}
                self._artists += self._axes.plot(x, y, **cross)
            if is_ego and is_shown:
                text = f"{agent['number']} {_outcome_name(agent) if has_ended else ''}".strip()
                self._artists.append(label_beside(self._axes, text, (x, y), _colour(agent)))

    def _write_header(self, step: int, drivers: dict[tuple[int, int], Driver]) -> None:
        facts = self.episode.facts
        title = f"{facts['scenario']}, {facts['traffic'] or 'no traffic'}   {step * self.dt:.1f} s"
        self._write(13, 0.01, title, fontsize=10)
        for number, agent in enumerate(self._egos):
            row, column = divmod(number, self._columns)
            line = f"{agent['number']} {agent['name']}: {self._status(agent, step, drivers)}"
            self._write(TITLE + LINE * row + 9, 0.01 + 0.98 * column / self._columns, line, _colour(agent))
        y = TITLE + LINE * math.ceil(len(self._egos) / self._columns) + 9
        groups = (
            (self._are_in_turn, False, "learning agents", EGOS[0]),
            (self._social, True, "social agents", SOCIAL),
        )
        for is_there, are_social, name, colour in groups:
            if is_there:
                counted = [each for each in drivers.values() if (each[0] in self._social) == are_social]
                self._write(y, 0.01, count_line(name, counted), colour)
                y += LINE

    def _write(self, below: float, x: float, line: str, colour: str = "black", fontsize: int = 8) -> None:
        """Write a line so many pixels below the picture's upper edge; x is a fraction of the width."""
        y = 1 - below / self._figure.bbox.height
        weight = "bold" if fontsize == 8 else "normal"
        style = {"va": "center", "color": colour, "weight": weight, "parse_math": False}
        self._artists.append(self._figure.text(x, y, line, fontsize=fontsize, **style))

    def _status(self, agent: dict[str, Any], step: int, drivers: dict[tuple[int, int], Driver]) -> str:
        """Return an ego's status: its outcome, or its speed while it has its vehicle."""
        if agent["entry_step"] < 0 or step < agent["entry_step"]:
            return "waits"
        if step >= agent["end_step"] and agent["outcome"] != Outcome.NONE:
            return f"{_outcome_name(agent)} at {agent['end_step'] * self.dt:.1f} s"
        slots, generations, speeds = self._present(step, "slot", "generation", "speed")
        speed = speeds[(slots == agent["slot"]) & (generations == agent["generation"])]
        if step > agent["end_step"] or not len(speed):
            return "gone"
        _, watches, _ = drivers.get((agent["slot"], agent["generation"]), (UNSET, False, False))
        return f"{'watches, ' if watches else ''}{speed[0]:.1f} m/s"


def count_line(name: str, drivers: Sequence[Driver]) -> str:
    """Return how many vehicles a group of agents drives, observes, and is to give back."""
    observed, leaving = (sum(each[k] for each in drivers) for k in (1, 2))
    driven = len(drivers) - leaving - observed
    return f"{name}: {driven} driven, {observed} in the air-lock, {leaving} leaving"


def _by_step(table: Mapping[str, NDArray]) -> dict[str, NDArray]:
    order = np.argsort(table["step"], kind="stable")
    return {name: column[order] for name, column in table.items()}


def _rows(table: Any) -> list[dict[str, Any]]:
    return [dict(zip(table, values, strict=True)) for values in zip(*table.values(), strict=True)]


def _colour(agent: dict[str, Any]) -> str:
    return EGOS[agent["number"] % len(EGOS)]


def _outcome_name(agent: dict[str, Any]) -> str:
    return Outcome(int(agent["outcome"])).name.lower().replace("_", " ")
