"""Draws a running simulation from above, without a display: what `render` of environments returns."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.artist import Artist

from smarts.arrays import Floats
from smarts.envision.animation import Image
from smarts.envision.bubble_shapes import placed_shapes
from smarts.envision.top_view import RING, Place, Shown, TopView, colour_of, goal_place, mark
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.scene import Scene
from smarts.types.bubbles import BubbleStates
from smarts.types.episode import AgentStart, EpisodeStart

WIDTH, HEIGHT = 800, 600
"""Size of a picture [pixels]."""
MARGIN = 15.0
"""Margin around the egos' routes [m]."""
NARROWEST, WIDEST = 80.0, 320.0
"""Width of what is shown [m]; where routes are longer, the picture follows an ego."""
_STRIDE = 40.0
"""A picture that follows moves by so much at a time, so that roads are seldom drawn [m]."""

Window = tuple[float, float, float]
"""x and y of the centre, and the width [m]."""


class WorldPicture:
    """Draws the present state of simulations as `TopView` does; the size of pictures never changes.

    Egos have numbers and rings at their goals.

    Args:
        scene: The world and its maps.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._shown: tuple[int, Window] | None = None

    def image(self, row: int, start: EpisodeStart, bubbles: BubbleStates | None = None) -> Image:
        """Return the picture of a simulation now, shape (600, 800, 3).

        Args:
            row: Row of the simulation.
            start: Its episode.
            bubbles: Where bubbles are; None: there are none.
        """
        world, roads = self._scene.world, self._scene.atlas.graphs[start.map]
        self._prepare(start, row, roads)
        vehicles, agents = world.vehicles, world.agents
        slots, held = np.flatnonzero(vehicles.alive[row]), np.flatnonzero(agents.slot[row] >= 0)
        columns = (
            ("generation", "heading", "length", "width"),
            ("slot", "generation", "state", "release_step"),
        )
        present = {name: getattr(vehicles, name)[row, slots] for name in columns[0]}
        states = {name: getattr(agents, name)[row, held] for name in columns[1]}
        x, y = vehicles.position[row, slots].T
        egos = [*enumerate(agents.slot[row, : world.egos].tolist())]
        seconds = float(world.step[row]) * world.dt
        shown = Shown(
            title=f"{start.scenario}, {start.traffic_name or 'no traffic'}   {seconds:.1f} s",
            vehicles={"slot": slots, "x": x, "y": y, **present},
            states={"agent_id": held, **states},
            social=range(world.egos, len(agents.slot[row])),
            lights=enumerate(world.signals[row].tolist()),
            shapes=[*self._goals(start, roads), *_bubbles(row, start, bubbles)],
            labels=[
                (str(agent_id), tuple(vehicles.position[row, slot].tolist()), colour_of(agent_id, ()))
                for agent_id, slot in egos
                if slot >= 0
            ],
        )
        return self._view.image(shown)

    def _prepare(self, start: EpisodeStart, row: int, roads: LaneGraph) -> None:
        """Draw roads, unless they are the last ones."""
        shown = start.map, self._window(start, row, roads)
        if shown != self._shown:
            self._shown, (x, y, width) = shown, shown[1]
            centre, half = np.array([x, y]), np.array([width, width * HEIGHT / WIDTH]) / 2
            self._view = TopView(roads, centre - half, centre + half, (WIDTH, HEIGHT))

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

    def _goals(self, start: EpisodeStart, roads: LaneGraph) -> Iterator[Artist]:
        for agent_id, agent in enumerate(start.agents[: self._scene.world.egos]):
            if goal := _goal(roads, agent):
                yield mark(goal, mec=colour_of(agent_id, ()), **RING)


def _bubbles(row: int, start: EpisodeStart, states: BubbleStates | None) -> Iterator[Artist]:
    for number, bubble in enumerate(start.bubbles if states is not None else ()):
        assert states is not None
        pose, is_active = states.pose[row, number].tolist(), bool(states.is_active[row, number])
        travels = bubble.followed != ""
        yield from placed_shapes(
            bubble.zone, bubble.margin, pose, name=bubble.id, travels=travels, is_active=is_active
        )


def _way(roads: LaneGraph, agent: AgentStart) -> Floats:
    """Return points of an agent's start, route and goal [m], shape (., 2)."""
    goal = _goal(roads, agent)
    points = [np.array([place]) for place in (agent.pose[:2], goal) if place is not None]
    # From start to goal only: the first and the last road go on before and behind.
    edges = agent.mission.route if goal is None else agent.mission.route[1:-1]
    lanes = [lane for edge in edges for lane in roads.edge_lanes(roads.edge_number(edge))]
    return np.concatenate([*points, *(roads.centreline(lane) for lane in lanes)])


def _goal(roads: LaneGraph, agent: AgentStart) -> Place | None:
    mission = agent.mission
    return goal_place(roads, mission.goal, mission.goal_position, mission.goal_lane, mission.goal_s)
