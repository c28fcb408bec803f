"""Draws a running simulation from above, without a display: what `render` of environments returns."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from smarts.arrays import Floats
from smarts.envision.bubble_shapes import bubble_shapes, moved
from smarts.envision.scenario_picture import draw_roads
from smarts.envision.vehicle_shapes import (
    CAR,
    DOTS_PER_INCH,
    EGOS,
    SOCIAL,
    Canvas,
    Image,
    driven_vehicles,
    label_beside,
    light_bars,
)
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.scene import Scene
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.bubbles import BubbleStates
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.mission import GoalKind

WIDTH, HEIGHT = 800, 600
"""Size of a picture [pixels]."""
MARGIN = 15.0
"""Margin around the egos' routes [m]."""
NARROWEST, WIDEST = 80.0, 320.0
"""Width of what is shown [m]; where routes are longer, the picture follows an ego."""
_STRIDE = 40.0
"""A picture that follows moves by so much at a time, so that roads are seldom drawn [m]."""
_TITLE = 20
"""Height of the first line of text [pixels]."""

Window = tuple[float, float, float]
"""x and y of the centre, and the width [m]."""


class WorldPicture:
    """Draws the present state of simulations; the size of pictures never changes.

    Egos have colours, numbers and rings at their goals, social agents are orange, traffic is blue, as in
    `EpisodePicture`.

    Args:
        scene: The world and its maps.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._axes: Any = None
        self._canvas: Any = None
        self._shown: tuple[int, Window] | None = None

    def image(self, row: int, start: EpisodeStart, bubbles: BubbleStates | None = None) -> Image:
        """Return the picture of a simulation now, shape (600, 800, 3).

        Args:
            row: Row of the simulation.
            start: Its episode.
            bubbles: Where bubbles are; None: there are none.
        """
        self._prepare(start, row)
        roads, signals = self._scene.atlas.graphs[start.map], self._scene.world.signals[row]
        return self._canvas.image(
            [
                *self._bubble_artists(row, start, bubbles),
                light_bars(self._axes, roads, enumerate(signals.tolist())),
                *self._vehicle_artists(row),
                *self._ego_artists(row, start),
                self._title(row, start),
            ]
        )

    def _prepare(self, start: EpisodeStart, row: int) -> None:
        """Draw roads, unless they are the last ones."""
        roads = self._scene.atlas.graphs[start.map]
        shown = start.map, self._window(start, row, roads)
        if shown == self._shown:
            return
        self._shown, (x, y, width) = shown, shown[1]
        figure = Figure(figsize=(WIDTH / DOTS_PER_INCH, HEIGHT / DOTS_PER_INCH), dpi=DOTS_PER_INCH)
        self._axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        draw_roads(self._axes, roads)
        height = width * HEIGHT / WIDTH
        self._axes.set_xlim(x - width / 2, x + width / 2)
        self._axes.set_ylim(y - height / 2, y + height / 2)
        self._axes.set_axis_off()
        self._canvas = Canvas(figure)

    def _window(self, start: EpisodeStart, row: int, roads: LaneGraph) -> Window:
        """Return what is shown: the egos' routes, or the surroundings of one of them."""
        egos = start.agents[: self._scene.world.egos]
        points = np.concatenate([_way(roads, each) for each in egos] or [roads.point_xy])
        low, high = points.min(0) - MARGIN, points.max(0) + MARGIN
        width = float(max(high[0] - low[0], (high[1] - low[1]) * WIDTH / HEIGHT, NARROWEST))
        if width <= WIDEST:
            return float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2, width
        x, y = np.round(self._followed(row, (low + high) / 2) / _STRIDE) * _STRIDE
        return float(x), float(y), WIDEST / 2

    def _followed(self, row: int, otherwise: Floats) -> Floats:
        """Return the position of the first ego that has a vehicle."""
        world = self._scene.world
        slots = world.agents.slot[row, : world.egos]
        there = slots[slots >= 0]
        return world.vehicles.position[row, there[0]] if len(there) else otherwise

    def _vehicle_artists(self, row: int) -> list[Any]:
        world = self._scene.world
        vehicles, slots = world.vehicles, np.flatnonzero(world.vehicles.alive[row])
        held = {slot: agent_id for agent_id, slot in enumerate(world.agents.slot[row].tolist()) if slot >= 0}
        agents = [held.get(slot, UNSET) for slot in slots.tolist()]
        states = [int(world.agents.state[row, each]) if each >= 0 else UNSET for each in agents]
        observes = np.array([each == AgentStatus.SHADOWING for each in states], np.bool_)
        leaves = np.array([each == AgentStatus.LEAVING for each in states], np.bool_)
        colours = [self._colour(each) for each in agents]
        x, y = vehicles.position[row, slots].T
        places = x, y, vehicles.heading[row, slots], vehicles.length[row, slots], vehicles.width[row, slots]
        return driven_vehicles(self._axes, places, colours, observes, leaves)

    def _colour(self, agent_id: int) -> str:
        if agent_id == UNSET:
            return CAR
        return EGOS[agent_id % len(EGOS)] if agent_id < self._scene.world.egos else SOCIAL

    def _ego_artists(self, row: int, start: EpisodeStart) -> list[Any]:
        """Return rings at goals, and numbers beside the egos' vehicles."""
        world, roads, artists = self._scene.world, self._scene.atlas.graphs[start.map], []
        for agent_id, agent in enumerate(start.agents[: world.egos]):
            colour = self._colour(agent_id)
            goal = _goal(roads, agent)
            if goal is not None:
                ring = {"marker": "o", "ms": 10, "mfc": "none", "mec": colour, "mew": 2}
                artists += self._axes.plot(*goal, zorder=9, **ring)
        for agent_id, slot in enumerate(world.agents.slot[row, : world.egos].tolist()):
            if slot >= 0:
                x, y = world.vehicles.position[row, slot].tolist()
                artists.append(label_beside(self._axes, str(agent_id), (x, y), self._colour(agent_id)))
        return artists

    def _bubble_artists(self, row: int, start: EpisodeStart, states: BubbleStates | None) -> list[Any]:
        artists = []
        for number, bubble in enumerate(start.bubbles if states is not None else ()):
            assert states is not None
            pose = states.pose[row, number].tolist()
            zone, margin = ([moved(ring, pose) for ring in rings] for rings in (bubble.zone, bubble.margin))
            is_active = bool(states.is_active[row, number])
            artists += bubble_shapes(zone, margin, name=bubble.id, is_active=is_active)
        return [self._axes.add_artist(each) for each in artists]

    def _title(self, row: int, start: EpisodeStart) -> Any:
        world = self._scene.world
        seconds = float(world.step[row]) * world.dt
        text = f"{start.scenario}, {start.traffic_name or 'no traffic'}   {seconds:.1f} s"
        frame = {"boxstyle": "square,pad=0.3", "fc": "white", "ec": "none", "alpha": 0.75}
        place = (0.01, 1 - _TITLE / HEIGHT)
        style = {"fontsize": 10, "zorder": 11, "bbox": frame, "parse_math": False}
        return self._axes.text(*place, text, transform=self._axes.transAxes, **style)


def _way(roads: LaneGraph, agent: AgentStart) -> Floats:
    """Return points of an agent's start, route and goal [m], shape (., 2)."""
    goal = _goal(roads, agent)
    points = [np.array([place]) for place in (agent.pose[:2], goal) if place is not None]
    # From start to goal only: the first and the last road go on before and behind.
    edges = agent.mission.route if goal is None else agent.mission.route[1:-1]
    lanes = [lane for edge in edges for lane in roads.edge_lanes(roads.edge_number(edge))]
    return np.concatenate([*points, *(roads.centreline(lane) for lane in lanes)])


def _goal(roads: LaneGraph, agent: AgentStart) -> tuple[float, float] | None:
    mission = agent.mission
    if mission.goal == GoalKind.POSITION:
        return mission.goal_position
    if mission.goal == GoalKind.LANE_LINE:
        return roads.pose_at(mission.goal_lane, mission.goal_s)[:2]
    return None
