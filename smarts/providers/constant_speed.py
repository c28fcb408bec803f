"""The traffic engine ConstantSpeed: vehicles follow their lanes at constant speed and ignore other vehicles.

It is an example of a traffic engine, and a baseline of non-reactive traffic. All simulations advance in the
same array operations. The engine reads the routes, flows and vehicles of the scenario's SUMO files and drives
at the lowest speed limit of each route, without lane changes, stops, traffic lights and right of way. They
enter where the route's first edge begins, in a lane that leads along it, and leave where its last one ends;
flows that are randomly spaced are evenly spaced from a random time on. On a repeated route vehicles go round
without end. All are cars of one size.
"""

from __future__ import annotations

import heapq
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.errors import TrafficError
from smarts.geometry.binding import bind
from smarts.geometry.frames import wrap_angle
from smarts.providers.gates import find_too_close
from smarts.providers.lane_paths import LanePaths
from smarts.providers.traffic_engine import TrafficEngine
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World

LENGTH, WIDTH = 5.0, 1.8
"""Size of every vehicle [m]."""
ROOM = 15.0
"""Minimum distance of an arrival from other vehicles [m]."""
TICKS = 16
"""Number of steps in which the warm-up looks for room at once."""
MOST_TURN = 0.05
"""Largest angle between a path and the heading of a vehicle that joins it [rad]."""
_FLOATS = [(name, np.float64) for name in ("time", "headway", "end")]
FLOW = np.dtype([("row", np.int32), ("path", np.int32), *_FLOATS])
"""Vehicles to come: simulation, path, next departure, time between two, time before which all are [s].
The last two are infinite for a single vehicle."""


class ConstantSpeed(TrafficEngine):
    """Moves vehicles at constant speed along the lanes of their routes.

    Args:
        world: The world.
        maps: The maps, by their number in the atlas.
        owner: The engine's owner number.
    """

    def __init__(self, world: World, maps: Sequence[LaneGraph], owner: int = Owner.TRAFFIC) -> None:
        self.failures: Mapping[int, TrafficError] = {}
        self.is_full = np.zeros(world.worlds, np.bool_)
        self._world, self._owner = world, owner
        self._maps, self._paths = tuple(maps), LanePaths(maps)
        self._flows = np.zeros(0, FLOW)
        self._known: list[dict[int, None]] = [{} for _ in range(world.worlds)]
        """The paths of each simulation's traffic, in the order of the files."""
        self._limit = np.zeros(world.worlds, np.int32)
        self._find_too_close = bind(find_too_close, world.vehicles)
        shape = world.vehicles.alive.shape
        self._generation = np.full(shape, -1, np.int32)
        """Generation of the vehicle that the engine drives in each slot, -1 for none, shape (B, V)."""
        self._path = np.zeros(shape, np.int32)
        self._s, self._t = np.zeros(shape), np.zeros(shape)
        """Distance along the path and to the left of it [m], shape (B, V)."""

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """See `TrafficEngine`; vehicles that depart in the warm-up are placed where they have driven to."""
        begun = np.isin(np.arange(self._world.worlds), list(starts))
        flows = [self._flows[~begun[self._flows["row"]]]]
        for row, start in starts.items():
            self._limit[row] = start.limit
            self._known[row].clear()
            generator = np.random.Generator(np.random.Philox(start.traffic_seed))
            for file in start.traffic.routes:
                begin = start.traffic.warm_up
                for edges, repeats, first, headway, end in _flows(file, generator):
                    numbers = tuple(map(self._maps[start.map].edge_number, edges))
                    path = self._paths.add(start.map, numbers, repeats=repeats)
                    self._known[row][path] = None
                    flows.append(np.array([(row, path, first - begin, headway, end - begin)], FLOW))
        self.is_full[begun], self._generation[begun] = False, -1
        self._flows = np.concatenate(flows)
        self._drive_warm_up(begun)

    def step(self, env_mask: Bools) -> None:
        """See `TrafficEngine`."""
        world, vehicles = self._world, self._world.vehicles
        driven = vehicles.alive & (vehicles.owner == self._owner) & env_mask[:, None]
        b, v = np.nonzero(driven & (self._generation != vehicles.generation))
        self._path[b, v], self._s[b, v], self._t[b, v] = self._nearest(b, v)
        vehicles.route[b, v] = -1  # the vehicle follows that path from now on, not its planned route
        self._generation[env_mask] = np.where(driven, vehicles.generation, -1)[env_mask]
        b, v = np.nonzero(driven)
        self._s[b, v] = self._paths.wrapped(self._path[b, v], self._s[b, v] + vehicles.speed[b, v] * world.dt)
        is_past_end = (self._path[b, v] < 0) | (self._s[b, v] > self._paths.length[self._path[b, v]])
        world.registry.dismiss(b[is_past_end], v[is_past_end])
        b, v = b[~is_past_end], v[~is_past_end]
        heading = vehicles.heading[b, v]
        self._write_poses(b, v)
        vehicles.yaw_rate[b, v] = wrap_angle(vehicles.heading[b, v] - heading) / world.dt
        vehicles.lateral_acceleration[b, v] = vehicles.speed[b, v] * vehicles.yaw_rate[b, v]
        vehicles.acceleration[b, v] = vehicles.lateral_speed[b, v] = vehicles.yaw_acceleration[b, v] = 0.0
        flows = self._flows
        due = np.flatnonzero(env_mask[flows["row"]] & (flows["time"] <= world.time[flows["row"]]))
        due = due[np.argsort(flows["time"][due], kind="stable")]
        # All vehicles of a flow depart at one place, so the next one is the only one that can have room.
        due = due[self._admit(flows["row"][due], flows["path"][due])]
        flows["time"][due] += flows["headway"][due]
        self._flows = flows[flows["time"] < flows["end"]]

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """See `TrafficEngine`: it accepts vehicles that are near a path, aligned, and overlap none."""
        path, s, t = self._nearest(rows, slots)
        refusals = np.where(path >= 0, Refusal.NONE, Refusal.OFF_LANES).astype(np.int8)
        near = np.flatnonzero(path >= 0)
        along = self._paths.poses(path[near], s[near], t[near])[:, 2]
        turn = np.abs(wrap_angle(along - self._world.vehicles.heading[rows[near], slots[near]]))
        overlaps = np.zeros(len(near), np.bool_)
        self._find_too_close(rows[near], slots[near], 0.0, 0.0, overlaps)
        refusals[near[overlaps]] = Refusal.TOO_CLOSE
        refusals[near[turn > MOST_TURN]] = Refusal.HEADING
        return refusals

    def close(self) -> None:
        """See `TrafficEngine`; there is nothing to free."""

    def _drive_warm_up(self, begun: Bools) -> None:
        """Let the vehicles of the warm-up depart as in steps; place those that have not arrived by then."""
        for row in np.flatnonzero(begun).tolist():
            path, departure = self._depart(row)
            b = np.full(len(path), row)
            s = self._paths.wrapped(path, -departure * self._world.dt * self._paths.speed[path])
            here = (s <= self._paths.length[path]) & self._is_free(b, path, s)
            self._place(b[here], path[here], s[here])
        self._flows = self._flows[self._flows["time"] < self._flows["end"]]

    def _depart(self, row: int) -> tuple[Ints, NDArray[np.int64]]:
        """Let the flows of a simulation depart in the steps up to time 0.

        Returns:
            Paths and steps of departure, at most 0, of N vehicles, of which some may have left.
        """
        flows, paths, dt = self._flows, self._paths, self._world.dt

        def step_at(time: float) -> int:
            return math.ceil(time / dt - 1e-6)

        path, departure = np.zeros(0, np.int32), np.zeros(0, np.int64)
        mine = np.flatnonzero((flows["row"] == row) & (flows["time"] <= 0.0) & (flows["time"] < flows["end"]))
        # The next step in which a flow may depart, the time at which it should, its place in the list.
        queue = [(step_at(flows["time"][flow]), flows["time"][flow], flow) for flow in mine.tolist()]
        heapq.heapify(queue)
        while queue and queue[0][0] <= 0:
            step, time, flow = heapq.heappop(queue)
            s = (step + np.arange(TICKS)[:, None] - departure) * dt * paths.speed[path]
            s = paths.wrapped(path, s)
            is_there = s <= paths.length[path]
            poses = paths.poses(np.broadcast_to(path, s.shape).ravel(), s.ravel(), np.zeros(s.size))
            ((x, y, _),) = paths.poses(flows["path"][flow : flow + 1], np.zeros(1), np.zeros(1))
            is_near = (np.hypot(poses[:, 0] - x, poses[:, 1] - y) < ROOM).reshape(s.shape)
            is_full = is_there.sum(axis=1) >= self._limit[row]
            self.is_full[row] |= is_full[0]
            free = np.append(~(is_full | (is_near & is_there).any(axis=1)), True)
            path, departure = path[is_there[0]], departure[is_there[0]]
            if free[0]:
                path, departure = np.append(path, flows["path"][flow]), np.append(departure, step)
                time = flows["time"][flow] = time + flows["headway"][flow]
                if time < flows["end"][flow]:
                    heapq.heappush(queue, (max(step_at(time), step + 1), time, flow))
            else:
                heapq.heappush(queue, (step + int(free.argmax()), time, flow))
        return path, departure

    def _is_free(self, b: Ints, path: Ints, s: Floats) -> Bools:
        """Return whether distances along paths [m] have room among all vehicles, shape (N,)."""
        vehicles = self._world.vehicles
        x, y, _ = self._paths.poses(path, s, np.zeros(len(path))).T
        gap = np.hypot(vehicles.position[b, :, 0] - x[:, None], vehicles.position[b, :, 1] - y[:, None])
        return ~((gap < ROOM) & vehicles.alive[b]).any(axis=1)

    def _admit(self, b: Ints, path: Ints) -> Bools:
        """Admit vehicles that have room where their paths begin; return which, shape (N,)."""
        s = np.zeros(len(path))
        x, y, _ = self._paths.poses(path, s, s).T
        has_room = self._is_free(b, path, s)
        is_near = np.hypot(x[:, None] - x, y[:, None] - y) < ROOM
        is_near = np.tril(is_near & (b[:, None] == b), -1)
        for number in np.flatnonzero(has_room & is_near.any(axis=1)).tolist():
            has_room[number] = not (is_near[number] & has_room).any()
        has_room[has_room] = self._place(b[has_room], path[has_room], s[has_room])
        return has_room

    def _place(self, b: Ints, path: Ints, s: Floats) -> Bools:
        """Admit vehicles at distances along their paths [m] up to the limit; return which, shape (N,)."""
        vehicles, paths = self._world.vehicles, self._paths
        rank = np.tril(b[:, None] == b, -1).sum(axis=1) + vehicles.alive[b].sum(axis=1)
        comes = rank < self._limit[b]
        self.is_full[b[~comes]] = True
        b, path, count = b[comes], path[comes], int(comes.sum())
        kind = np.full(count, VehicleKind.PASSENGER, np.int8)
        size = np.full(count, LENGTH), np.full(count, WIDTH)
        v = self._world.registry.admit_unnamed(b, self._owner, kind, *size)
        self._path[b, v], self._s[b, v], self._t[b, v] = path, s[comes], 0.0
        self._generation[b, v] = vehicles.generation[b, v]
        vehicles.speed[b, v] = paths.speed[path]
        self._write_poses(b, v)
        return comes

    def _nearest(self, b: NDArray, v: NDArray) -> tuple[Ints, Floats, Floats]:
        """Return path, s and t [m] of vehicles, shape (N,) each; path is -1 if no path is near."""
        vehicles = self._world.vehicles
        poses = np.column_stack([vehicles.position[b, v], vehicles.heading[b, v]]).tolist()
        known = [tuple(self._known[row]) for row in b.tolist()]
        found = [self._paths.nearest(paths, *pose) for paths, pose in zip(known, poses, strict=True)]
        path, s, t = np.array(found).reshape(-1, 3).T
        return path.astype(np.int32), s, t

    def _write_poses(self, b: NDArray, v: NDArray) -> None:
        """Write the poses and routes of vehicles into their rows."""
        vehicles, path = self._world.vehicles, self._path[b, v]
        poses = self._paths.poses(path, self._s[b, v], self._t[b, v])
        vehicles.position[b, v], vehicles.heading[b, v] = poses[:, :2], poses[:, 2]
        vehicles.height[b, v] = self._paths.heights(path, self._s[b, v])
        vehicles.desired_speed[b, v] = self._paths.speed[path]
        unplanned = vehicles.route[b, v] < 0
        for row, slot, number in np.column_stack([b, v, path])[unplanned].tolist():
            vehicles.route[row, slot] = self._world.routes.number(row, self._paths.edges[number])


def _flows(
    file: Path, generator: np.random.Generator
) -> Iterator[tuple[list[str], bool, float, float, float]]:
    """Yield edges, whether they repeat, and first departure, headway and end [s] of flows and vehicles.

    Headway and end of a vehicle are infinite.

    Args:
        file: A SUMO route file.
        generator: Draws the first departures of flows, whose vehicles are evenly spaced.

    Raises:
        TrafficError: The file cannot be read, or its format differs from that of built scenarios.
    """
    try:
        root = ElementTree.parse(file).getroot()
        routes = {
            route.get("id"): (route.attrib["edges"].split(), int(route.get("repeat", "1")) > 1)
            for route in root.iterfind("route")
        }
        for element in root.iterfind("vehicle"):
            depart = float(element.attrib["depart"])
            yield *routes[element.get("route")], depart, np.inf, np.inf
        for flow in root.iterfind("flow"):
            begin, end = float(flow.attrib["begin"]), float(flow.attrib["end"])
            rate = flow.get("vehsPerHour")
            headway = 3600.0 / float(rate) if rate else 1.0 / float(flow.attrib["period"][4:-1])
            yield *routes[flow.get("route")], begin + generator.uniform(0, headway), headway, end
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
        raise TrafficError(
            f"{type(error).__name__}: {error}", place=str(file), remedy="build the scenario again"
        ) from error
