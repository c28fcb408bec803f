"""The traffic engine Native."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.errors import TrafficError
from smarts.geometry.binding import Replaceable, bind
from smarts.providers.gates import find_too_close
from smarts.providers.native.demand import Built, is_ballistic
from smarts.providers.native.occupancy import place_of
from smarts.providers.native.state import Traffic
from smarts.providers.native.stepping import begin, find_new, refusal_to_give, step, take_over, would_brake
from smarts.providers.native.tables import make_traffic
from smarts.providers.traffic_engine import TrafficEngine
from smarts.roads.atlas import RoadAtlas
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner
from smarts.types.world import World

MOST_OFFSET, MOST_TURN = 0.4, 0.05
"""Largest offset from its lane's centreline [m] and angle to it [rad] of a vehicle that the engine takes."""


class Native(TrafficEngine):
    """Drives the traffic of all simulations in one kernel by the rules of SUMO; `docs/develop/native.md`.

    Args:
        world: The world.
        maps: The maps, by their number in the atlas.
        owner: The engine's owner number.
    """

    def __init__(self, world: World, maps: Sequence[LaneGraph], owner: int = Owner.TRAFFIC) -> None:
        self.failures: Mapping[int, TrafficError] = {}
        self._world, self._maps = world, tuple(maps)
        self._atlas, self._built = RoadAtlas(self._maps), Built(maps, world.dt)
        self._traffic = Replaceable(make_traffic(world, self._atlas, int(owner), self._built))
        self._size = self._built.size
        self._found = np.zeros((2, world.vehicles.alive.size), np.int32)
        self._find_too_close = bind(find_too_close, world.vehicles)
        self._find_new, self._step, self._begin, self._place_of, self._take_over, self._would_brake = (
            bind(each, self._traffic) for each in (find_new, step, begin, place_of, take_over, would_brake)
        )
        self._refusal_to_give = bind(refusal_to_give, self._traffic)

    @property
    def is_full(self) -> Bools:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See `TrafficEngine`."""
        return self.traffic.sims["is_full"]

    @property
    def traffic(self) -> Traffic:
        """The arrays."""
        return self._traffic.value

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """See `TrafficEngine`.

        Raises:
            TrafficError: A scenario asks for what native traffic does not support.
        """
        wanted = [self._built.add(start.map, start.traffic) for start in starts.values()]
        self._update()
        n = self.traffic
        for (row, start), (flows, routes) in zip(starts.items(), wanted, strict=True):
            sim = n.sims[row]
            sim["seed"], sim["limit"] = start.traffic_seed, start.limit
            sim["flow"], sim["flows"], sim["route"] = flows.start, len(flows), routes.start
            sim["stranger"] = self._built.kinds[is_ballistic(start.traffic, n.dt)][0]
            numbers = [self._world.routes.number(row, self._built.routes[route]) for route in routes]
            n.route_number[row, : len(numbers)] = numbers
            self._begin(row, round(start.traffic.warm_up / n.dt))

    def step(self, env_mask: Bools) -> None:
        """See `TrafficEngine`."""
        rows, slots = self._found
        for place in range(self._find_new(env_mask, rows, slots)):
            self._take(int(rows[place]), int(slots[place]))
        self._step(env_mask)

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """See `TrafficEngine`; it takes vehicles in the middle of a lane, from which a way leads on."""
        overlaps = np.zeros(len(rows), np.bool_)
        self._find_too_close(rows, slots, 0.0, 0.0, overlaps)
        vehicles = zip(rows.tolist(), slots.tolist(), overlaps.tolist(), strict=True)
        return np.array([self._refusal_to_take(*each) for each in vehicles], np.int8)

    def can_release(self, rows: Ints, slots: Ints) -> Bytes:
        """See `KeepsVehicles`."""
        vehicles = zip(rows.tolist(), slots.tolist(), strict=True)
        return np.array([self._refusal_to_give(row, slot) for row, slot in vehicles], np.int8)

    def close(self) -> None:
        """See `TrafficEngine`; there is nothing to free."""

    def _update(self) -> None:
        """Give the kernels the tables, with room for what has been added."""
        if self._built.size == self._size:
            return
        n, tables = self.traffic, self._built.tables(self._world.worlds)
        for name in ("pending", "route_number", "light_states"):
            old = getattr(n, name)
            tables[name][:, : old.shape[1]] = old
        self._traffic.replace(n._replace(**tables))
        self._size = self._built.size

    def _take(self, row: int, slot: int) -> None:
        """Begin to drive a vehicle of another provider, on the lane that it is on, or the nearest."""
        lane, s, t, _ = self._place_of(row, slot)
        vehicles, (kind, factor) = self._world.vehicles, self._driver(row, slot)
        way = self._way(row, slot, lane)
        edges = self._built.routes[int(self.traffic.ways["route"][way])]
        vehicles.route[row, slot] = self._world.routes.number(row, edges)
        front = s + 0.5 * float(vehicles.length[row, slot])
        self._take_over(row, slot, kind, way, front, float(np.clip(t, -1.5, 1.5)), factor)

    def _refusal_to_take(self, row: int, slot: int, overlaps: bool) -> int:
        """Return why the engine does not take a vehicle, as a `Refusal`."""
        lane, s, t, turn = self._place_of(row, slot)
        here, half = self.traffic.lanes[lane], 0.5 * float(self._world.vehicles.length[row, slot])
        if lane < 0:
            return Refusal.OFF_LANES
        if here["inside"] or s < half or s + half > here["length"]:
            return Refusal.IN_JUNCTION
        if overlaps:
            return Refusal.TOO_CLOSE
        if abs(turn) > MOST_TURN:
            return Refusal.HEADING
        if abs(t) > MOST_OFFSET:
            return Refusal.OFFSET
        return self._would_brake(row, slot, self._way(row, slot, lane), s + half, *self._driver(row, slot))

    def _driver(self, row: int, slot: int) -> tuple[int, float]:
        """Return the type and the speed factor of a vehicle's driver, as before, else of its kind."""
        n, vehicles = self.traffic, self._world.vehicles
        car = n.by_slot[row, slot]
        if car["last"] == vehicles.generation[row, slot] and car["driver"] >= 0:
            return int(car["driver"]), float(car["factor"])
        ballistic = bool(n.types["ballistic"][n.sims["stranger"][row]])
        return self._built.kinds[ballistic][int(vehicles.kind[row, slot])], 1.0

    def _way(self, row: int, slot: int, lane: int) -> int:
        """Return a row of ways for a vehicle on a lane: of its planned route, else of a way on from there."""
        number, graph = int(self._world.map[row]), self._maps[self._world.map[row]]
        lane = max(lane - int(self._atlas.roads.lane_base[number]), 0)
        lane = graph.way_across(lane)[-1]
        edge, planned = int(graph.lane_edge[lane]), int(self._world.vehicles.route[row, slot])
        edges = self._world.routes.edges(row, planned).tolist() if planned >= 0 else []
        onward = edges[edges.index(edge) :] if edge in edges else _way_on(graph, lane)
        _, first = self._built.route(number, onward)
        self._update()
        return first + lane - int(graph.edge_first_lane[edge])


def _way_on(graph: LaneGraph, lane: int) -> list[int]:
    """Return the edges of a way from a lane: at each junction the first lane that it leads into."""
    edges, seen = [int(graph.lane_edge[lane])], {lane}
    while len(onward := graph.successors(lane)):
        lane = int(onward[0])
        if lane in seen:
            break
        seen.add(lane)
        if not graph.is_internal[lane]:
            edges.append(int(graph.lane_edge[lane]))
    return edges
