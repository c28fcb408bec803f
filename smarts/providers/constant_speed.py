"""The traffic engine ConstantSpeed: vehicles follow their lanes at constant speed and ignore other vehicles.

It is an example of a traffic engine, and a baseline of non-reactive traffic. All simulations advance in the
same array operations. The engine reads the routes, flows and vehicles of the scenario's SUMO files and drives
at the lowest speed limit of each route, without lane changes, stops, traffic lights and right of way. They
enter where the route's first edge begins, in a lane that leads along it, and leave where its last one ends;
flows that are randomly spaced are evenly spaced from a random time on. On a repeated route vehicles go round
without end. All are cars of one size.
"""

from __future__ import annotations

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
MOST_TURN = 0.05
"""Between a path and the heading of a vehicle that joins it [rad]."""
_FLOATS = [(name, np.float64) for name in ("time", "headway", "end")]
FLOW = np.dtype([("row", np.int32), ("path", np.int32), *_FLOATS])
"""Vehicles to come: simulation, path, next departure, time between two, time before which all are [s]."""


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
        due = due[self._admit(flows["row"][due], flows["path"][due], np.zeros(len(due)))]
        self._pass(due, 1)

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
        """Admit vehicles where they are at time 0; those without room, or that have left, never come."""
        flows, paths = self._flows, self._paths
        due = np.flatnonzero(begun[flows["row"]] & (flows["time"] <= 0.0) & (flows["time"] < flows["end"]))
        time, headway, end = (flows[name][due] for name in ("time", "headway", "end"))
        counts = np.minimum(-time // headway + 1, np.ceil((end - time) / headway)).astype(np.int64)
        each, numbers = np.repeat(due, counts), np.concatenate([np.arange(0), *map(np.arange, counts)])
        late = -(flows["time"][each] + numbers * flows["headway"][each])
        order = np.argsort(-late, kind="stable")
        row, path, late = flows["row"][each[order]], flows["path"][each[order]], late[order]
        s = paths.wrapped(path, late * paths.speed[path])
        here = s <= paths.length[path]
        self._admit(row[here], path[here], s[here])
        self._pass(due, counts)

    def _pass(self, flows: NDArray, counts: NDArray | int) -> None:
        """Take vehicles off flows, and flows without further ones off the list."""
        self._flows["time"][flows] += counts * self._flows["headway"][flows]
        self._flows = self._flows[self._flows["time"] < self._flows["end"]]

    def _admit(self, b: Ints, path: Ints, s: Floats) -> Bools:
        """Admit vehicles that have room at distances along their paths [m]; return which, shape (N,)."""
        vehicles, paths = self._world.vehicles, self._paths
        x, y, _ = paths.poses(path, s, np.zeros(len(path))).T
        is_near = np.hypot(x[:, None] - x, y[:, None] - y) < ROOM
        has_room = ~np.tril(is_near & (b[:, None] == b), -1).any(axis=1)
        gap = np.hypot(vehicles.position[b, :, 0] - x[:, None], vehicles.position[b, :, 1] - y[:, None])
        has_room &= ~((gap < ROOM) & vehicles.alive[b]).any(axis=1)
        rank = np.tril((b[:, None] == b) & has_room, -1).sum(axis=1) + vehicles.alive[b].sum(axis=1)
        self.is_full[b[rank >= self._limit[b]]] = True
        comes = has_room & (rank < self._limit[b])
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
        vehicles.desired_speed[b, v] = self._paths.speed[path]
        unplanned = vehicles.route[b, v] < 0
        for row, slot, number in np.column_stack([b, v, path])[unplanned].tolist():
            vehicles.route[row, slot] = self._world.routes.number(row, self._paths.edges[number])


def _flows(
    file: Path, generator: np.random.Generator
) -> Iterator[tuple[list[str], bool, float, float, float]]:
    """Yield edges, whether they repeat, and first departure, headway and end [s] of flows and vehicles.

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
            yield *routes[element.get("route")], depart, 1.0, depart + 1.0
        for flow in root.iterfind("flow"):
            begin, end = float(flow.attrib["begin"]), float(flow.attrib["end"])
            rate = flow.get("vehsPerHour")
            headway = 3600.0 / float(rate) if rate else 1.0 / float(flow.attrib["period"][4:-1])
            yield *routes[flow.get("route")], begin + generator.uniform(0, headway), headway, end
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
        raise TrafficError(
            f"{type(error).__name__}: {error}", place=str(file), remedy="build the scenario again"
        ) from error
