"""The traffic engine Recorded."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.errors import TrafficError
from smarts.geometry.binding import Replaceable, bind
from smarts.providers.gates import find_too_close
from smarts.providers.recorded import following, state, stepping
from smarts.providers.recorded.stepping import MOST_OFFSET, MOST_TURN
from smarts.providers.traffic_engine import TrafficEngine
from smarts.recordings.log import NAME, Log, lane_path, lanes_onward
from smarts.recordings.paths import Paths
from smarts.roads.atlas import RoadAtlas
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner
from smarts.types.world import World

LOG = logging.getLogger("smarts")
BRAKING = 4.5
"""A vehicle is not taken where its driver would brake harder [m/s^2]."""


class Recorded(TrafficEngine):
    """Drives the vehicles of recordings in all simulations in one kernel; `docs/guide/recorded.md`.

    Args:
        world: The world.
        maps: The maps, by their number in the atlas.
        owner: The engine's owner number.

    Attributes:
        sims: Records of the simulations, among them how many vehicles were `held_back` by others in their
            place and have entered late or never; the logger `smarts` says it when the episode is over.
    """

    def __init__(self, world: World, maps: Sequence[LaneGraph], owner: int = Owner.TRAFFIC) -> None:
        self.failures: Mapping[int, TrafficError] = {}
        self._world, self._atlas, self._owner = world, RoadAtlas(maps), int(owner)
        shape = world.vehicles.alive.shape
        self.sims = np.zeros(shape[0], state.SIMULATION)
        self._cars = np.zeros(shape, state.CAR)
        self._traffic = Replaceable(
            state.Recorded(
                owner=int(owner),
                dt=world.dt,
                step=world.step,
                used=world.registry.used,
                vehicles=world.vehicles,
                sims=self.sims,
                cars=self._cars,
                entry=np.zeros((shape[0], 1), np.int8),
                paths=Paths.empty(),
            )
        )
        self._points = cache(lambda path: self._traffic.value.paths.points(path))
        self._logs: dict[Path, tuple[range, Floats]] = {}
        self._lights: dict[int, Floats] = {}
        """What is still to be shown in each simulation."""
        self._change = np.full(shape[0], np.inf)
        """When the next light of each simulation changes, in the recording [s], shape (B,)."""
        self._lanes: dict[tuple[int, int], int] = {}
        """Path of each lane of each map, as far as known."""
        self._names: list[str] = []
        self._routes: list[tuple[int, ...]] = []
        """Name and route of each path."""
        self._found = np.zeros((2, world.vehicles.alive.size), np.int32)
        self._left = np.zeros_like(self._found)
        self._find_too_close = bind(find_too_close, world.vehicles)
        kernels = stepping.step, stepping.find_new, stepping.find_due, stepping.enter, stepping.take
        self._step, self._find_new, self._find_due, self._enter, self._take_over = (
            bind(each, self._traffic) for each in kernels
        )
        self._acceleration = bind(following.acceleration, self._traffic)
        self._nearest_place = bind(following.nearest_place, self._traffic)

    @property
    def is_full(self) -> Bools:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See `TrafficEngine`."""
        return self.sims["is_full"]

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """See `TrafficEngine`."""
        for row, start in starts.items():
            if count := int(self.sims["held_back"][row]):
                LOG.info("recorded traffic: %d vehicles entered late or never, as others were there", count)
            recording: Any = start.traffic.recording  # as `Schedule` requires
            tracks, self._lights[row] = self._log(recording.log)
            self.sims[row] = np.zeros((), state.SIMULATION)
            self._cars[row] = np.zeros((), state.CAR)
            self._cars["generation"][row] = self._cars["track"][row] = -1
            self._traffic.value.entry[row] = state.Entry.TO_COME
            sim = self.sims[row]
            sim["first"] = sim["next"] = sim["oldest"] = tracks.start
            sim["last"], sim["begin"], sim["limit"] = tracks.stop, recording.begin, start.limit
            sim["reacts"] = recording.mode == "reactive"
            self._show(row)
            self._admit(self._find_due(row, *self._found, 0))

    def step(self, env_mask: Bools) -> None:
        """See `TrafficEngine`."""
        rows, slots = self._found
        for place in range(self._find_new(env_mask, rows, slots)):
            self._take(int(rows[place]), int(slots[place]))
        entering, leaving = self._step(env_mask, *self._found, *self._left)
        now = self.sims["begin"] + self._world.step * self._world.dt
        for row in np.flatnonzero(env_mask & (self._change <= now + stepping.SLACK)).tolist():
            self._show(row)
        for row, slot in self._left[:, :leaving].T.tolist():
            self._world.registry.dismiss(row, slot)
        self._admit(entering)

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """See `TrafficEngine`; it takes vehicles that are near their own track's path, or a lane."""
        overlaps = np.zeros(len(rows), np.bool_)
        self._find_too_close(rows, slots, 0.0, 0.0, overlaps)
        vehicles = zip(rows.tolist(), slots.tolist(), overlaps.tolist(), strict=True)
        return np.array([self._refusal_to_take(*each) for each in vehicles], np.int8)

    def close(self) -> None:
        """See `TrafficEngine`; there is nothing to free."""

    def _admit(self, count: int) -> None:
        """Let in the vehicles of the tracks that the kernel has found."""
        world, paths = self._world, self._traffic.value.paths
        for row, track in self._found[:, :count].T.tolist():
            size = float(paths.length[track]), float(paths.width[track])
            name = NAME + self._names[track]
            slot = world.registry.admit(row, name, self._owner, int(paths.kind[track]), *size)
            world.vehicles.route[row, slot] = world.routes.number(row, self._routes[track])
            world.paths[row][slot, int(world.vehicles.generation[row, slot])] = self._points(track)
            self._enter(row, slot, track)

    def _show(self, row: int) -> None:
        """Write what lights show now."""
        now = self.sims["begin"][row] + self._world.step[row] * self._world.dt
        shown, self._lights[row] = np.split(
            self._lights[row], [np.searchsorted(self._lights[row][:, 0], now + stepping.SLACK)]
        )
        self._change[row] = self._lights[row][0, 0] if len(self._lights[row]) else np.inf
        # Of changes of one lane the last one stays.
        self._world.signals[row, shown[:, 1].astype(int)] = shown[:, 2]

    def _take(self, row: int, slot: int) -> None:
        """Begin to drive a vehicle that another provider has driven."""
        path, *place = self._path_of(row, slot)
        if path < 0:
            self._world.registry.dismiss(row, slot)
            return
        self._world.vehicles.route[row, slot] = self._world.routes.number(row, self._routes[path])
        self._take_over(row, slot, path, *place)

    def _path_of(self, row: int, slot: int) -> tuple[int, float, float, float]:
        """Return the path that a vehicle is to follow and its place there; -1 where there is no lane."""
        car, vehicles, m = self._cars[row, slot], self._world.vehicles, int(self._world.map[row])
        pose = *vehicles.position[row, slot].tolist(), float(vehicles.heading[row, slot])
        if car["generation"] == vehicles.generation[row, slot] and car["track"] >= 0:
            place = self._nearest_place(int(car["track"]), *pose)
            if abs(place[1]) <= MOST_OFFSET and abs(place[2]) <= MOST_TURN:
                return int(car["track"]), *place
        found = self._atlas.locate(
            self._world.map[[row]],
            vehicles.position[row, [slot]],
            vehicles.heading[row, [slot]],
            height=vehicles.height[row, [slot]],
        )
        lane = int(found.lane[0])
        if lane < 0:
            return -1, 0.0, np.inf, 0.0
        path = self._lane_path(m, lane)
        return path, *self._nearest_place(path, *pose)

    def _refusal_to_take(self, row: int, slot: int, overlaps: bool) -> int:
        """Return why the engine does not take a vehicle, as a `Refusal`."""
        path, s, offset, turn = self._path_of(row, slot)
        if abs(offset) > MOST_OFFSET:
            return Refusal.OFF_LANES
        if abs(turn) > MOST_TURN:
            return Refusal.HEADING
        if overlaps:
            return Refusal.TOO_CLOSE
        needed = self._acceleration(row, slot, path, s, False)
        return Refusal.SPEED if needed < -BRAKING else Refusal.NONE

    def _log(self, file: Path) -> tuple[range, Floats]:
        """Return the paths and the lights of a log; read it if it is new."""
        if file not in self._logs:
            log = Log.load(file)
            first = self._add(log.paths, log.names, log.routes)
            self._logs[file] = range(first, first + len(log.names)), log.lights
        return self._logs[file]

    def _lane_path(self, m: int, lane: int) -> int:
        """Return the path along a lane to the end of its map."""
        if (m, lane) not in self._lanes:
            roads = self._atlas.graphs[m]
            edges = tuple(int(roads.lane_edge[each]) for each in lanes_onward(roads, lane))
            route = tuple(edge for edge in edges if not roads.edge_is_internal[edge])
            self._lanes[m, lane] = self._add(lane_path(roads, lane), ("",), (route,))
        return self._lanes[m, lane]

    def _add(self, paths: Paths, names: Sequence[str], routes: Sequence[tuple[int, ...]]) -> int:
        """Append paths behind the known ones, and return the row of the first."""
        traffic, first = self._traffic.value, len(self._names)
        self._names += names
        self._routes += routes
        entry = traffic.entry
        if len(names) > entry.shape[1]:
            entry = np.pad(entry, ((0, 0), (0, len(names) - entry.shape[1])))
        self._traffic.replace(traffic._replace(paths=traffic.paths.joined(paths), entry=entry))
        return first
