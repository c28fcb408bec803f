"""The traffic engine Native."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.errors import TrafficError
from smarts.geometry.binding import Replaceable, bind
from smarts.geometry.frames import wrap_angle
from smarts.providers.gates import find_too_close
from smarts.providers.native.demand import Built
from smarts.providers.native.hand_over import find_new, refusal_to_give, take_over, would_brake
from smarts.providers.native.state import Demand, Lights, Pending
from smarts.providers.native.stepping import begin, step
from smarts.providers.native.tables import make_traffic, read_signals
from smarts.providers.traffic_engine import TrafficEngine
from smarts.roads.atlas import RoadAtlas
from smarts.roads.lane_graph import LaneGraph
from smarts.types import columns
from smarts.types.episode import EpisodeStart
from smarts.types.traffic import TrafficFiles
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner
from smarts.types.world import World

MOST_OFFSET, MOST_TURN = 0.4, 0.05
"""Largest offset from its lane's centreline [m] and angle to it [rad] of a vehicle that the engine takes."""
TAKEN_FACTOR = 1.0
"""Speed factor of drivers of vehicles that the engine has not driven before."""


class Native(TrafficEngine):
    """Drives the traffic of all simulations in one kernel by the rules of SUMO; `docs/develop/native.md`.

    Args:
        world: The world.
        maps: The maps, by their number in the atlas.
        owner: The engine's owner number.
    """

    def __init__(self, world: World, maps: Sequence[LaneGraph], owner: int = Owner.TRAFFIC) -> None:
        self.failures: Mapping[int, TrafficError] = {}
        self.is_full = np.zeros(world.worlds, np.bool_)
        self._world, self._maps, self._owner = world, tuple(maps), int(owner)
        self._atlas, self._built = RoadAtlas(self._maps), Built(maps)
        self._nets: list[Path | None] = [None] * len(self._maps)
        self._arrays = make_traffic(world, self._atlas, self._owner)
        self._find_new = bind(find_new, self._arrays)
        self._found = np.zeros((2, world.vehicles.alive.size), np.int32)
        self._find_too_close = bind(find_too_close, world.vehicles)
        self._demand = Replaceable(self._tables(1))
        self._size = self._built.size
        self._step, self._begin, self._take_over, self._would_brake, self._refusal_to_give = (
            bind(each, self._arrays, self._demand)
            for each in (step, begin, take_over, would_brake, refusal_to_give)
        )

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """See `TrafficEngine`.

        Raises:
            TrafficError: A scenario asks for what native traffic does not support.
        """
        wanted = {row: self._add(start.map, start.traffic) for row, start in starts.items()}
        for row, start in starts.items():
            n, (flows, routes) = self._arrays, wanted[row]
            n.seed[row], n.limit[row] = start.traffic_seed, start.limit
            n.flow_start[row], n.flow_count[row] = flows.start, len(flows)
            n.route_start[row] = routes.start
            n.ballistic[row] = _is_ballistic(start.traffic, self._world.dt)
            for place, number in enumerate(routes):
                self._demand.value.route_number[row, place] = self._world.routes.number(
                    row, self._built.routes[number]
                )
            self._begin(row, round(start.traffic.warm_up / self._world.dt))
            self.is_full[row] = n.is_full[row]

    def step(self, env_mask: Bools) -> None:
        """See `TrafficEngine`."""
        rows, slots = self._found
        for place in range(self._find_new(env_mask, rows, slots)):
            self._take(int(rows[place]), int(slots[place]))
        self._step(env_mask)
        self.is_full[:] = self._arrays.is_full

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """See `TrafficEngine`; it takes vehicles in the middle of a lane, from which a way leads on."""
        vehicles, found = self._world.vehicles, np.zeros(len(rows), np.int8)
        overlaps = np.zeros(len(rows), np.bool_)
        self._find_too_close(rows, slots, 0.0, 0.0, overlaps)
        for place, (row, slot) in enumerate(zip(rows.tolist(), slots.tolist(), strict=True)):
            lane, s, t, turn = self._place(row, slot)
            half = 0.5 * float(vehicles.length[row, slot])
            found[place] = self._refusal(row, slot, lane, s, t, turn, bool(overlaps[place]))
            if found[place] == Refusal.NONE:
                way = self._way(row, slot, lane)
                kind, factor = self._driver(row, slot)
                found[place] = self._would_brake(row, slot, kind, way, s + half, factor)
        return found

    def can_release(self, rows: Ints, slots: Ints) -> Bytes:
        """See `KeepsVehicles`."""
        vehicles = zip(rows.tolist(), slots.tolist(), strict=True)
        return np.array([self._refusal_to_give(row, slot) for row, slot in vehicles], np.int8)

    def close(self) -> None:
        """See `TrafficEngine`; there is nothing to free."""

    def _add(self, number: int, files: TrafficFiles) -> tuple[range, range]:
        """Return the flows and routes of a scenario; make room for them."""
        found, demand = self._built.add(number, files), self._demand.value
        most = max(len(found[0]), len(found[1]))
        if self._nets[number] is None or most > demand.pending.next.shape[1]:
            self._nets[number] = files.net
            grown = self._tables(max(most, demand.pending.next.shape[1]))
            for old, new in zip(
                (*demand[4], *demand[5], demand[6]), (*grown[4], *grown[5], grown[6]), strict=True
            ):
                new[:, : old.shape[1]] = old
            self._demand.replace(grown)
            self._size = self._built.size
        self._update()
        return found

    def _tables(self, most: int) -> Demand:
        """Return the tables of all scenarios, with room for so many flows or routes of one."""
        worlds = self._world.worlds
        signals = read_signals(self._maps, self._atlas.roads.lane_base, self._nets)
        pending = columns.allocate(Pending, (worlds, most))
        lights = columns.allocate(Lights, (worlds, len(signals.offset)))
        return Demand(*self._built.tables(), signals, pending, lights, np.zeros((worlds, most), np.int32))

    def _update(self) -> None:
        """Give the kernels the tables if routes or flows have been added."""
        if self._built.size != self._size:
            types, ways, flows = self._built.tables()
            self._demand.replace(self._demand.value._replace(types=types, ways=ways, flows=flows))
            self._size = self._built.size

    def _take(self, row: int, slot: int) -> None:
        """Begin to drive a vehicle of another provider, on the lane that it is on, or the nearest."""
        lane, s, t, _ = self._place(row, slot)
        vehicles, (kind, factor) = self._world.vehicles, self._driver(row, slot)
        way = self._way(row, slot, max(lane, 0))
        edges = self._built.routes[self._demand.value.ways.route[way]]
        vehicles.route[row, slot] = self._world.routes.number(row, edges)
        offset = float(np.clip(t, -1.5, 1.5)) if lane >= 0 else 0.0
        front = s + 0.5 * float(vehicles.length[row, slot])
        self._take_over(row, slot, kind, way, front, offset, factor)

    def _place(self, row: int, slot: int) -> tuple[int, float, float, float]:
        """Return a vehicle's lane, -1 for none, its place along and beside it [m], its angle to it [rad]."""
        vehicles, maps = self._world.vehicles, self._world.map[[row]]
        pose = vehicles.position[[row], slot], vehicles.heading[[row], slot]
        found = self._atlas.locate(maps, *pose, height=vehicles.height[[row], slot])
        graph, lane, s, t = self._maps[maps[0]], int(found.lane[0]), float(found.s[0]), float(found.t[0])
        if lane < 0 or found.distance[0] > 0.5 * graph.width[lane]:
            return -1, 0.0, 0.0, 0.0
        return lane, s, t, float(wrap_angle(pose[1][0] - graph.pose_at(lane, s)[2]))

    def _refusal(
        self, row: int, slot: int, lane: int, s: float, t: float, turn: float, overlaps: bool
    ) -> Refusal:
        """Return why the engine does not take a vehicle at a place, see `_place`."""
        graph, half = self._maps[self._world.map[row]], 0.5 * float(self._world.vehicles.length[row, slot])
        if lane < 0:
            return Refusal.OFF_LANES
        if graph.is_internal[lane] or s < half or s + half > graph.length[lane]:
            return Refusal.IN_JUNCTION
        if overlaps:
            return Refusal.TOO_CLOSE
        if abs(turn) > MOST_TURN:
            return Refusal.HEADING
        return Refusal.OFFSET if abs(t) > MOST_OFFSET else Refusal.NONE

    def _driver(self, row: int, slot: int) -> tuple[int, float]:
        """Return the type and the speed factor of a vehicle's driver, as before, else of its kind."""
        driven, vehicles = self._arrays.driven, self._world.vehicles
        if driven.last[row, slot] == vehicles.generation[row, slot]:
            return int(driven.type[row, slot]), float(driven.factor[row, slot])
        return self._built.kinds[int(vehicles.kind[row, slot])], TAKEN_FACTOR

    def _way(self, row: int, slot: int, lane: int) -> int:
        """Return a row of ways for a vehicle on a lane: of its planned route, else of a way on from there."""
        number, graph = int(self._world.map[row]), self._maps[self._world.map[row]]
        while graph.is_internal[lane] and len(graph.successors(lane)):
            lane = int(graph.successors(lane)[0])
        edge, planned = int(graph.lane_edge[lane]), int(self._world.vehicles.route[row, slot])
        edges = self._world.routes.edges(row, planned).tolist() if planned >= 0 else []
        onward = edges[edges.index(edge) :] if edge in edges else _way_on(graph, lane)
        _, first = self._built.route(number, onward)
        self._update()
        return int(first[0]) + lane - int(graph.edge_first_lane[edge])


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


def _is_ballistic(files: TrafficFiles, dt: float) -> bool:
    """Return whether SUMO would move these vehicles by the ballistic rule."""
    given = dict(files.options).get("step-method.ballistic")
    if given is not None:
        return given == "true"
    return round(1000 * (files.reaction_time or 0.0)) // round(1000 * dt) > 1
