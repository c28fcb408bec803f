"""Where on the map everybody is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.roads.atlas import RoadAtlas
from smarts.roads.seat_routes import SeatRoutes
from smarts.types.world import World

Bools = NDArray[np.bool_]


class MapLocator:
    """Finds all vehicles' lanes, and the seats' progress along their routes."""

    def __init__(self, atlas: RoadAtlas, routes: SeatRoutes) -> None:
        self._atlas = atlas
        self._routes = routes

    def locate(self, world: World, rows: Bools) -> None:
        """Write lane, lane_position and lane_offset of all vehicles, and where agents are on their routes."""
        vehicles = world.vehicles
        row, slot = np.nonzero(vehicles.alive & rows[:, None])
        found = self._atlas.locate(
            world.map[row],
            vehicles.position[row, slot],
            vehicles.heading[row, slot],
            self._routes_of(world)[row, slot],
            self._routes.table,
        )
        vehicles.lane[row, slot] = found.lane
        vehicles.lane_position[row, slot] = found.s
        vehicles.lane_offset[row, slot] = found.t
        self._measure_progress(world, rows)

    def _routes_of(self, world: World) -> NDArray[np.int32]:
        """Return the route number of each slot, -1 without one, shape (B, V)."""
        numbers = np.full(world.vehicles.alive.shape, -1, np.int32)
        row, seat = np.nonzero(world.seats.slot >= 0)
        numbers[row, world.seats.slot[row, seat]] = self._routes.number[row, seat]
        return numbers

    def _measure_progress(self, world: World, rows: Bools) -> None:
        vehicles, seats = world.vehicles, world.seats
        row, seat = np.nonzero((seats.slot >= 0) & rows[:, None])
        slot = seats.slot[row, seat]
        maps, position = world.map[row], vehicles.position[row, slot]
        done, remaining = self._atlas.route_distances(
            self._routes.table,
            maps,
            self._routes.number[row, seat],
            vehicles.lane[row, slot],
            vehicles.lane_position[row, slot],
            seats.route_done[row, seat],
        )
        is_on_route = np.isfinite(done)
        seats.on_route[row, seat] = is_on_route
        seats.route_done[row[is_on_route], seat[is_on_route]] = done[is_on_route]
        seats.remaining[row[is_on_route], seat[is_on_route]] = remaining[is_on_route]
        seats.on_road[row, seat] = self._atlas.on_road(maps, position)
        seats.corners_on_road[row, seat] = self._atlas.corners_on_road(
            maps,
            position,
            vehicles.heading[row, slot],
            vehicles.length[row, slot],
            vehicles.width[row, slot],
        )
