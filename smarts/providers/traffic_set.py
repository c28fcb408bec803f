"""The traffic of B simulations: one engine each, stepped in turn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.providers.traffic_provider import Roster, TrafficProvider
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.world import World

Bools = NDArray[np.bool_]


class RouteNumbers(Protocol):
    """Numbers the planned routes of one simulation; implemented in `smarts.sim.route_book`."""

    def number(self, edges: Sequence[str]) -> int:
        """Return the number of a route, a new one if nobody has planned it so far."""
        ...


class TrafficSet:
    """One traffic engine for each simulation.

    Args:
        engines: Engine b drives in simulation b.
        maps: The maps by their number in the atlas.
    """

    def __init__(self, engines: Sequence[TrafficProvider], maps: Sequence[LaneGraph]) -> None:
        self._engines = tuple(engines)
        self._maps = tuple(maps)

    def reset(
        self, world: World, row: int, start: EpisodeStart, roster: Roster, routes: RouteNumbers
    ) -> None:
        """Begin an episode of one simulation; traffic joins those who are in it."""
        engine = self._engines[row]
        states = world.vehicles[row]
        engine.reset(start.traffic, start.sumo_seed, states, roster, self._maps[start.map], start.limit)
        self._finish(world, row, routes)

    def step(self, world: World, rows: Bools, routes: Sequence[RouteNumbers]) -> None:
        """Advance the traffic of some simulations; the rows of others hold the end of the step already."""
        for row in np.flatnonzero(rows).tolist():
            self._engines[row].step(world.vehicles[row])
            self._finish(world, row, routes[row])

    def can_accept(self, row: int, slot: int) -> bool:
        """Return whether the engine of a simulation could drive on with a vehicle of another."""
        return self._engines[row].can_accept(slot)

    def close(self) -> None:
        """Give back what the engines hold."""
        for engine in self._engines:
            engine.close()

    def _finish(self, world: World, row: int, routes: RouteNumbers) -> None:
        """Copy the lights, and number the routes of those whose plans are new."""
        engine, vehicles = self._engines[row], world.vehicles
        world.signals[row, : len(engine.signals)] = engine.signals
        unknown = (vehicles.owner[row] == engine.owner) & (vehicles.route[row] < 0)
        for slot in np.flatnonzero(unknown).tolist():
            vehicles.route[row, slot] = routes.number(engine.route(slot))
