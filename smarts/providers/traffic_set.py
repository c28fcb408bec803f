"""The traffic of B simulations: one engine each, stepped in turn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.errors import TrafficError
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.providers.traffic_provider import Roster, TrafficProvider
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.vehicles import Owner, VehicleStates
from smarts.types.world import World

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]


class RouteNumbers(Protocol):
    """Numbers the planned routes of one simulation; implemented in `smarts.sim.route_book`."""

    def number(self, edges: Sequence[str]) -> int:
        """Return the number of a route, a new one if nobody has planned it so far."""
        ...

    def __getitem__(self, number: int) -> tuple[str, ...]: ...


class TrafficSet:
    """One traffic engine for each simulation. If one fails, the others go on.

    Args:
        engines: Engine b drives in simulation b.
        maps: The maps by their number in the atlas.
        build: Makes a new engine in place of one that has failed; by default the failed one is reset.
    """

    def __init__(
        self,
        engines: Sequence[TrafficProvider],
        maps: Sequence[LaneGraph],
        build: Callable[[], TrafficProvider] | None = None,
    ) -> None:
        self.failures: Mapping[int, TrafficError] = {}
        """What went wrong in the last step, by row."""
        self._engines = list(engines)
        self._maps = tuple(maps)
        self._build = build
        self._broken: set[int] = set()
        self._introduced: list[dict[int, int]] = [{} for _ in engines]
        self._seats = [b""] * len(self._engines)
        self._states: dict[int, VehicleStates] = {}
        self._bound: tuple[World, Callable[[int, int, int], int]] | None = None

    def reset(
        self, world: World, row: int, start: EpisodeStart, roster: Roster, routes: RouteNumbers
    ) -> None:
        """Begin an episode of one simulation; traffic joins those who are in it.

        Raises:
            TrafficError: The engine refused; the next reset works.
        """
        if row in self._broken and self._build is not None:
            _end(self._engines[row])
            self._engines[row] = self._build()
        self._broken.add(row)
        # Once for the episode: to make some twenty views takes as long as to write the vehicles into them.
        self._states[row] = states = world.vehicles[row]
        self._introduced[row] = {}
        bound_for = self._strangers(world, row, routes)
        self._seats[row] = _who_sits_where(world, row)
        self._engines[row].reset(
            start.traffic,
            start.sumo_seed,
            states,
            roster,
            self._maps[start.map],
            start.limit,
            bound_for,
        )
        self._finish(world, row, routes)
        self._broken.discard(row)

    def step(self, world: World, rows: Bools, routes: Sequence[RouteNumbers]) -> None:
        """Advance the traffic of some simulations; the rows of others hold the end of the step already."""
        failures: dict[int, TrafficError] = {}
        for row in np.flatnonzero(rows).tolist():
            try:
                self._step(world, row, routes[row])
            except TrafficError as error:
                self._broken.add(row)
                failures[row] = error
        self.failures = failures

    def can_accept(self, row: int, slot: int) -> bool:
        """Return whether the engine of a simulation could drive on with a vehicle of another."""
        return self._engines[row].can_accept(slot)

    def close(self) -> None:
        """Give back what the engines hold, the failed ones too."""
        for row, engine in enumerate(self._engines):
            if row in self._broken:
                _end(engine)
            else:
                engine.close()

    def _step(self, world: World, row: int, routes: RouteNumbers) -> None:
        engine, seats = self._engines[row], _who_sits_where(world, row)
        if seats != self._seats[row]:
            self._seats[row] = seats
            for slot, edges in self._strangers(world, row, routes).items():
                if edges:
                    engine.set_route(slot, edges)
        engine.step(self._states[row])
        self._finish(world, row, routes)

    def _strangers(self, world: World, row: int, routes: RouteNumbers) -> dict[int, tuple[str, ...]]:
        """Return the routes of agents' vehicles that traffic has not heard of yet, by slot, and note them."""
        vehicles, known = world.vehicles, self._introduced[row]
        generations = {
            slot: int(vehicles.generation[row, slot])
            for slot in np.flatnonzero(vehicles.owner[row] == Owner.AGENT).tolist()
        }
        self._introduced[row] = generations
        return {
            slot: routes[number] if (number := int(vehicles.route[row, slot])) >= 0 else ()
            for slot, generation in generations.items()
            if known.get(slot) != generation
        }

    def _finish(self, world: World, row: int, routes: RouteNumbers) -> None:
        """Copy the lights, and number the routes of those whose plans are new."""
        if self._bound is None or self._bound[0] is not world:
            self._bound = world, bind(next_unplanned, world.vehicles.owner, world.vehicles.route)
        engine, find = self._engines[row], self._bound[1]
        world.signals[row, : len(engine.signals)] = engine.signals
        slot = -1
        while (slot := find(row, engine.owner, slot + 1)) >= 0:
            world.vehicles.route[row, slot] = routes.number(engine.route(slot))


@kernel
def next_unplanned(owner: Ints, route: Ints, row: int, provider: int, begin: int) -> int:
    """Return the first slot from `begin` on whose vehicle a provider drives without a route, or -1."""
    for slot in range(begin, owner.shape[1]):
        if owner[row, slot] == provider and route[row, slot] < 0:
            return slot
    return -1


def _who_sits_where(world: World, row: int) -> bytes:
    """Return what changes whenever an agent comes to a vehicle."""
    seats = world.seats
    return seats.slot[row].tobytes() + seats.generation[row].tobytes() + seats.state[row].tobytes()


def _end(engine: TrafficProvider) -> None:
    """Close an engine that has failed, and may fail at that, too."""
    try:
        engine.close()
    except TrafficError:
        return
