"""The traffic engine ConstantSpeed: vehicles that keep to their lanes and their speed, whatever is ahead.

An example of a traffic engine, and a baseline of drivers that react to nothing. All simulations advance in
the same array operations. The engine reads the routes, flows and vehicles of the scenario's SUMO files,
drives at the lowest speed limit of each route, and has no lane changes, no stops, no lights and no right of
way. All vehicles are cars of one size, whatever their types.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.errors import TrafficError
from smarts.geometry.frames import wrap_angle
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
"""Distance of an arrival from other vehicles [m]."""
DEPARTURE = np.dtype([("row", np.int32), ("time", np.float64), ("path", np.int32)])
"""A vehicle yet to come: its simulation, when [s], on which path."""


class ConstantSpeed(TrafficEngine):
    """Vehicles at constant speed along the lanes of their routes.

    Args:
        world: The state.
        maps: The maps by their number in the atlas.
        owner: Its number among the providers.
    """

    def __init__(self, world: World, maps: Sequence[LaneGraph], owner: int = Owner.TRAFFIC) -> None:
        self.failures: Mapping[int, TrafficError] = {}
        self.is_full = np.zeros(world.worlds, np.bool_)
        self._world, self._owner = world, owner
        self._maps, self._paths = tuple(maps), LanePaths(maps)
        self._coming = np.zeros(0, DEPARTURE)
        self._known: list[dict[int, None]] = [{} for _ in range(world.worlds)]
        """The paths of each simulation's traffic, in order."""
        self._limit = np.zeros(world.worlds, np.int32)
        shape = world.vehicles.alive.shape
        self._generation = np.full(shape, -1, np.int32)
        """Generation of the vehicle that the engine drives in each slot, -1 for none, shape (B, V)."""
        self._path = np.zeros(shape, np.int32)
        self._s, self._t = np.zeros(shape), np.zeros(shape)
        """Along the path, and to the left of it [m]."""

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """See `TrafficEngine`; the traffic of the warm-up is where its speed has brought it."""
        begun = np.isin(np.arange(self._world.worlds), list(starts))
        coming = [self._coming[~begun[self._coming["row"]]]]
        for row, start in starts.items():
            self._limit[row] = start.limit
            self._known[row].clear()
            generator = np.random.Generator(np.random.Philox(start.traffic_seed))
            for file in start.traffic.routes:
                for edges, times in _departures(file, generator):
                    numbers = tuple(map(self._maps[start.map].edge_number, edges))
                    each, path = np.zeros(len(times), DEPARTURE), self._paths.add(start.map, numbers)
                    self._known[row][path] = None
                    each["row"], each["path"] = row, path
                    each["time"] = times - start.traffic.warm_up
                    coming.append(each)
        self.is_full[begun], self._generation[begun] = False, -1
        self._coming = np.concatenate(coming)
        self._let_in(begun)
        # Those that found no room, or have been through already, do not come later.
        is_past = begun[self._coming["row"]] & (self._coming["time"] <= 0.0)
        self._coming = self._coming[~is_past]

    def step(self, env_mask: Bools) -> None:
        """See `TrafficEngine`."""
        world, vehicles = self._world, self._world.vehicles
        driven = vehicles.alive & (vehicles.owner == self._owner) & env_mask[:, None]
        b, v = np.nonzero(driven & (self._generation != vehicles.generation))
        self._path[b, v], self._s[b, v], self._t[b, v] = self._nearest(b, v)
        vehicles.route[b, v] = -1  # it follows that path from now on, whatever it had planned
        self._generation[env_mask] = np.where(driven, vehicles.generation, -1)[env_mask]
        b, v = np.nonzero(driven)
        self._s[b, v] += vehicles.speed[b, v] * world.dt
        is_out = (self._path[b, v] < 0) | (self._s[b, v] > self._paths.length[self._path[b, v]])
        world.registry.dismiss(b[is_out], v[is_out])
        b, v = b[~is_out], v[~is_out]
        heading = vehicles.heading[b, v]
        self._show(b, v)
        vehicles.yaw_rate[b, v] = wrap_angle(vehicles.heading[b, v] - heading) / world.dt
        vehicles.lateral_acceleration[b, v] = vehicles.speed[b, v] * vehicles.yaw_rate[b, v]
        vehicles.acceleration[b, v] = vehicles.lateral_speed[b, v] = vehicles.yaw_acceleration[b, v] = 0.0
        self._let_in(env_mask)

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """See `TrafficEngine`: there must be a path close by."""
        return np.where(self._nearest(rows, slots)[0] >= 0, Refusal.NONE, Refusal.OFF_LANES).astype(np.int8)

    def close(self) -> None:
        """See `TrafficEngine`; there is nothing to free."""

    def _let_in(self, env_mask: Bools) -> None:
        """Admit the vehicles whose time has come, each if there is room for it."""
        vehicles, coming, paths = self._world.vehicles, self._coming, self._paths
        late = self._world.time[coming["row"]] - coming["time"]
        s = np.where(self._world.step[coming["row"]] == 0, late * paths.speed[coming["path"]], 0.0)
        due = np.flatnonzero(env_mask[coming["row"]] & (late >= 0.0) & (s <= paths.length[coming["path"]]))
        due = due[np.argsort(coming["time"][due], kind="stable")]
        b, path, s = coming["row"][due], coming["path"][due], s[due]
        x, y, _ = paths.poses(path, s, np.zeros(len(due))).T
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
        self._show(b, v)
        self._coming = np.delete(coming, due[comes])

    def _nearest(self, b: NDArray, v: NDArray) -> tuple[Ints, Floats, Floats]:
        """Return path, s and t of vehicles, shape (N,) each; path -1 where there is none."""
        vehicles = self._world.vehicles
        poses = np.column_stack([vehicles.position[b, v], vehicles.heading[b, v]]).tolist()
        known = [tuple(self._known[row]) for row in b.tolist()]
        found = [self._paths.nearest(paths, *pose) for paths, pose in zip(known, poses, strict=True)]
        path, s, t = np.array(found).reshape(-1, 3).T
        return path.astype(np.int32), s, t

    def _show(self, b: NDArray, v: NDArray) -> None:
        """Write the poses and plans of vehicles into their rows."""
        vehicles, path = self._world.vehicles, self._path[b, v]
        poses = self._paths.poses(path, self._s[b, v], self._t[b, v])
        vehicles.position[b, v], vehicles.heading[b, v] = poses[:, :2], poses[:, 2]
        vehicles.desired_speed[b, v] = self._paths.speed[path]
        unplanned = vehicles.route[b, v] < 0
        for row, slot, number in np.column_stack([b, v, path])[unplanned].tolist():
            vehicles.route[row, slot] = self._world.routes.number(row, self._paths.edges[number])


def _departures(file: Path, generator: np.random.Generator) -> Iterator[tuple[list[str], Floats]]:
    """Yield the edges of each flow and vehicle of one of SUMO's route files, and when vehicles depart [s].

    Raises:
        TrafficError: The file cannot be read, or says departures in another way than the scenarios' build.
    """
    try:
        root = ElementTree.parse(file).getroot()
        edges = {route.get("id"): route.attrib["edges"].split() for route in root.iterfind("route")}
        for element in root.iterfind("vehicle"):
            yield edges[element.get("route")], np.array([float(element.attrib["depart"])])
        for flow in root.iterfind("flow"):
            begin, end = float(flow.attrib["begin"]), float(flow.attrib["end"])
            rate = flow.get("vehsPerHour")
            headway = 3600.0 / float(rate) if rate else 1.0 / float(flow.attrib["period"][4:-1])
            # Spaced evenly, each flow at a phase of its own.
            yield edges[flow.get("route")], np.arange(begin + generator.uniform(0, headway), end, headway)
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
        raise TrafficError(
            f"{type(error).__name__}: {error}", place=str(file), remedy="build the scenario again"
        ) from error
