"""Draws recorded episodes from above, without a display."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from smarts.arrays import Floats, Longs
from smarts.envision.animation import Image
from smarts.envision.episode_bubbles import EpisodeBubbles
from smarts.envision.top_view import RING, Columns, Place, Shown, TopView, colour_of, goal_place, mark
from smarts.sim.episode_files import RecordedEpisode
from smarts.types.agent_states import UNSET
from smarts.types.events import Outcome
from smarts.types.vehicles import Owner

MARGIN = 20.0
"""Margin around the agents' paths [m]."""
NARROWEST = 60.0
"""Minimum width and height of the picture [m]."""
TRAIL = 3.0
"""Duration of the trail behind an agent [s]."""
OUTCOME_SHOWN = 4.0
"""How long an agent's outcome is shown at its last position [s]; the last picture shows all outcomes."""
COLLISION = {"marker": (10, 1, 0), "ms": 17, "mfc": "#ffdd33", "mec": "#c00000", "mew": 1.2, "zorder": 9}
"""The star at a vehicle that collided."""
PIXELS = 900


class EpisodePicture:
    """Draws any step of one episode as `TopView` does.

    Each ego has a number, that of its row in the table `agents`, a colour, a trail, a ring at its goal, and
    its speed beside it. A cross marks its last position, or a star if it collided, with its outcome beside it
    for `OUTCOME_SHOWN`. Zones of bubbles are shaded, their margins have dashed lines.

    Args:
        episode: The recorded episode.
        pixels: Width of the picture; the height follows from the map [pixels].
    """

    def __init__(self, episode: RecordedEpisode, *, pixels: int = PIXELS) -> None:
        self.episode = episode
        self.dt = float(episode.facts["dt"])
        self.steps = int(episode.facts["steps"])
        table = episode.table("agents")
        columns = zip(*table.values(), strict=True)
        agents = [dict(zip(table, row, strict=True)) | {"number": n} for n, row in enumerate(columns)]
        is_ego = table["interface"] < 0
        self._social = {*table["agent_id"][~is_ego].tolist()} - {UNSET}
        agent_ids = table["agent_id"][is_ego]
        # Agents that learn in bubbles have agent_ids in turn: they have no labels.
        egos = 0 if len(np.unique(agent_ids)) < len(agent_ids) else len(agent_ids)
        self._egos, self._others = agents[:egos], agents[egos:]
        states = episode.table("agent_states")
        order = np.argsort(states["step"], kind="stable")
        self._vehicles = episode.table("vehicles")
        self._states = {name: column[order] for name, column in states.items()}
        self._bubbles, self._roads = EpisodeBubbles(episode), episode.roads()
        low, high = self._window()
        # Even numbers of pixels for video.
        height = 2 * round(pixels * (high - low)[1] / (high - low)[0] / 2)
        self._view = TopView(self._roads, low, high, (pixels & ~1, height))

    def image(self, step: int) -> Image:
        """Return the picture of a step, counted from the reset (step 0), shape (height, width, 3)."""
        return self._view.image(self.shown(step))

    def shown(self, step: int) -> Shown:
        """Return what is drawn of a step."""
        facts, signals = self.episode.facts, self.episode.table("signals")
        until = signals["step"] <= step
        lights = dict(zip(signals["lane"][until].tolist(), signals["signal"][until].tolist(), strict=True))
        return Shown(
            title=f"{facts['scenario']}, {facts['traffic'] or 'no traffic'}   {step * self.dt:.1f} s",
            vehicles=_of(self._vehicles, step),
            states=_of(self._states, step),
            social=self._social,
            lights=lights.items(),
            shapes=[*self._bubbles.shapes(step), *self._marks(step)],
            labels=[*self._labels(step)],
        )

    def _marks(self, step: int) -> Iterator[Artist]:
        """Yield goals, trails, and the crosses and stars where agents ended."""
        first = max(0, step - round(TRAIL / self.dt))
        for agent in self._egos:
            if goal := self._goal_of(agent):
                yield mark(goal, mec=self._colour(agent), **RING)
            if agent["entry_step"] <= step <= agent["end_step"]:
                style = {"colors": self._colour(agent), "linewidths": 2.5, "alpha": 0.5, "zorder": 5}
                yield LineCollection([self._path(agent, first, step)], **style)
        for agent in [*self._egos, *self._others]:
            is_ego, since = agent["number"] < len(self._egos), step - int(agent["end_step"])
            if agent["entry_step"] < 0 or since < 0 or not (is_ego or self._is_recent(since, step)):
                continue
            place = tuple(self._path(agent, 0, step)[-1].tolist())
            if agent["outcome"] == Outcome.COLLISION:
                yield mark(place, **COLLISION)
            elif is_ego and since > 0 and agent["outcome"] != Outcome.NONE:
                yield mark(place, marker="x", ms=11, mew=2.5, color=self._colour(agent), zorder=9)

    def _labels(self, step: int) -> Iterator[tuple[str, Place, str]]:
        for agent in self._egos:
            since = step - int(agent["end_step"])
            if 0 <= agent["entry_step"] <= step and self._is_recent(since, step):
                row = self._rows(agent, 0, step)[-1]
                x, y, speed = (float(self._vehicles[name][row]) for name in ("x", "y", "speed"))
                has_ended = since >= 0 and agent["outcome"] != Outcome.NONE
                outcome = Outcome(int(agent["outcome"])).name.lower().replace("_", " ")
                text = f"{agent['number']} {outcome if has_ended else f'{speed:z.1f} m/s'}"
                yield text, (x, y), self._colour(agent)

    def _is_recent(self, since: int, step: int) -> bool:
        """Return whether what ended so many steps ago is still shown."""
        return since * self.dt <= OUTCOME_SHOWN or step == self.steps

    def _colour(self, agent: dict[str, Any]) -> str:
        return colour_of(agent["number"], self._social)

    def _goal_of(self, agent: dict[str, Any]) -> Place | None:
        """Return where an agent's goal is, None without one."""
        position = float(agent["goal_x"]), float(agent["goal_y"])
        lane, s = int(agent["goal_lane"]), float(agent["goal_s"])
        return goal_place(self._roads, agent["goal"], position, lane, s)

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
        rows = self._rows(agent, first, last)
        return np.stack([self._vehicles[name][rows] for name in ("x", "y")], -1)

    def _rows(self, agent: dict[str, Any], first: int, last: int) -> Longs:
        """Return the rows of an agent's vehicle from step `first` to `last` or its end, shape (T,)."""
        rows = _slice(self._vehicles, first, min(last, int(agent["end_step"])))
        is_own = self._vehicles["slot"][rows] == agent["slot"]
        is_own &= self._vehicles["generation"][rows] == agent["generation"]
        return rows.start + np.flatnonzero(is_own)


def _slice(columns: Columns, first: int, last: int) -> slice:
    """Return the rows of some steps in a table that is in order of steps."""
    return slice(*np.searchsorted(columns["step"], [first, last + 1]).tolist())


def _of(columns: Columns, step: int) -> dict[str, NDArray]:
    rows = _slice(columns, step, step)
    return {name: column[rows] for name, column in columns.items()}
