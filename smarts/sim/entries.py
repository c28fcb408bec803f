"""Entries: how agents come into an episode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.roads.seat_routes import SeatRoutes
from smarts.sim.ownership import Ownership
from smarts.types.episode import EpisodeStart, SeatStart
from smarts.types.seats import SeatState
from smarts.types.world import World

Bools = NDArray[np.bool_]


class Entries:
    """Puts agents into their seats, at the beginning of the episode or when their time has come."""

    def __init__(self, ownership: Ownership, routes: SeatRoutes) -> None:
        self._ownership = ownership
        self._routes = routes
        self._starts: list[Sequence[SeatStart]] = [() for _ in range(len(ownership.rosters))]

    def reset(self, world: World, row: int, start: EpisodeStart) -> None:
        """Give the missions of an episode out, in an empty simulation, and let in who enters at once."""
        self._starts[row] = start.seats
        self._routes.assign(row, start.map, [seat.mission.route for seat in start.seats])
        for seat, seat_start in enumerate(start.seats):
            route = self._ownership.routes[row].number(seat_start.mission.route)
            world.missions.write(row, seat, seat_start.mission, route)
            world.seats.agent[row, seat] = seat
            world.seats.state[row, seat] = SeatState.WAITING
        self._enter(world, row)

    def enter(self, world: World, rows: Bools) -> None:
        """Let in those whose time has come."""
        waiting = (world.seats.state == SeatState.WAITING).any(axis=1) & rows
        for row in np.flatnonzero(waiting).tolist():
            self._enter(world, row)

    def _enter(self, world: World, row: int) -> None:
        for seat, start in enumerate(self._starts[row]):
            is_due = start.entry_time <= world.step[row] * world.dt
            if is_due and world.seats.state[row, seat] == SeatState.WAITING:
                self._ownership.admit(row, seat, start)
