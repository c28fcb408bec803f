"""Traffic that SUMO drives, in this process.

Without agents, the result equals that of `sumo` with the same files, options, seed and step.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from smarts.errors import TrafficError
from smarts.geometry.binding import bind
from smarts.geometry.boxes import boxes_overlap
from smarts.geometry.frames import heading_from_compass
from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_rows import centre_of, fill_rows, next_unplanned
from smarts.providers.sumo_shadows import SumoShadows
from smarts.roads.lane_graph import LaneGraph
from smarts.types.traffic import Signal, TrafficFiles
from smarts.types.vehicles import Owner, VehicleKind, VehicleStates
from smarts.types.world import World

SPAWN_MARGIN = (10.0, 1.0)
"""Kept free of traffic around a vehicle that enters: before and behind it, and on either side [m]."""

_KINDS = {kind.name.lower(): kind for kind in VehicleKind}
_KINDS |= {"delivery": VehicleKind.TRUCK, "moped": VehicleKind.MOTORCYCLE}
"""`VehicleKind` of SUMO's vehicle classes; others are passenger cars."""

_LIGHTS = np.full(256, Signal.NONE, np.int8)
_LIGHTS[list(b"rR")] = Signal.STOP
_LIGHTS[list(b"yYuoOs")] = Signal.CAUTION
_LIGHTS[list(b"gG")] = Signal.GO
"""`Signal` of each letter of SUMO's signal states; an unlit light (o, O) asks for caution, and so does an
arrow for turning right after a stop (s)."""


class _Snapshot(NamedTuple):
    """The columns that SUMO follows, as of its last step; bytes compare faster than arrays of this size."""

    owner: bytes
    generation: bytes
    route: bytes


def _snapshot(states: VehicleStates) -> _Snapshot:
    return _Snapshot(states.owner.tobytes(), states.generation.tobytes(), states.route.tobytes())


def sumo_options(files: TrafficFiles, seed: int, dt: float) -> list[str]:
    """Return SUMO's command line; another simulation with it has exactly the same traffic."""
    options = ["--net-file", str(files.net), "--seed", str(seed), "--step-length", repr(dt)]
    if files.routes:
        options += ["--route-files", ",".join(map(str, files.routes))]
    if files.additional:
        options += ["--additional-files", ",".join(map(str, files.additional))]
    # A lane change takes 3 s instead of one step; vehicles are not removed from jams or after collisions.
    options += ["--lanechange.duration", "3", "--time-to-teleport", "-1"]
    options += ["--collision.action", "none", "--collision.check-junctions", "true"]
    return [*options, "--no-step-log", "--no-warnings", "--xml-validation", "never"]


class SumoTraffic:
    """One simulation's traffic: SUMO drives the vehicles of its owner number and reacts to all others.

    A vehicle keeps one SUMO id for life. When another becomes a row's owner, its SUMO vehicle is led as a
    shadow from the next step on; when SUMO becomes it again, SUMO drives on from that pose and speed. A row
    that others have admitted gets a SUMO vehicle, and a row that others have dismissed loses it. A vehicle
    handed to SUMO while it stands on no lane leaves the world (`can_accept` tells beforehand). SUMO's drivers
    expect a vehicle of others to take its `route`.

    At the limit of vehicles SUMO holds departures back until one has left (`is_full`), so what an episode
    looks like depends on the limit only if the limit is too small.

    Args:
        world: The state, of which it reads and writes one row.
        row: The simulation.
        owner: SUMO's number among the providers.
        library: Which copy of libsumo to use; by default any that is free.

    Attributes:
        signals: Of the map's lanes, in the world.
        is_full: Whether departures have had to wait in this episode.

    Raises:
        TrafficError: From every method, when SUMO fails; other simulations continue, and the next `reset`
            works.
    """

    def __init__(
        self, world: World, row: int, owner: int = Owner.TRAFFIC, library: int | None = None
    ) -> None:
        if not (math.isfinite(world.dt) and 0.001 <= world.dt <= 10.0):
            raise TrafficError(f"a step of {world.dt} s", place="dt", remedy="give 0.001 to 10 s")
        self.signals = world.signals[row]
        self.is_full = False
        self._world, self._row, self._owner = world, row, int(owner)
        # Once: to make some twenty views takes as long as to write the vehicles into them.
        self._states = states = world.vehicles.of(row)
        self._library = SumoLibrary(library)
        self._shadows = SumoShadows(self._library, states)
        self._ids: dict[int, str] = {}
        self._driven: dict[str, int] = {}
        self._kept_clear: list[int] = []
        self._limit = 0
        self._is_new = np.zeros(states.capacity, np.bool_)
        self._has_begun = False
        self._fill = bind(fill_rows, states, self._is_new, world.dt)
        self._next_unplanned = bind(next_unplanned, states)

    def reset(self, files: TrafficFiles, seed: int, roads: LaneGraph, limit: int | None = None) -> None:
        """Begin an episode: load, warm up, and let the traffic into the world.

        Egos may be at their starts; traffic keeps clear of them.

        Args:
            files: The traffic.
            seed: SUMO's, in [0, 2^31).
            roads: The lanes of the net in `files`.
            limit: The most vehicles that SUMO knows at a time, those of others included; by default as many
                as there are slots.
        """
        self._library.check_open()
        self._has_begun = False
        self._roads, states = roads, self._states
        self._shadows.reset(roads)
        self._ids.clear()
        self._driven.clear()
        self._limit = states.capacity if limit is None else limit
        self._is_new[:] = False
        self.is_full = False
        self._read_map(roads)
        self._start(files, seed)
        with self._library.errors("failed while the traffic warmed up"):
            self._kept_clear = np.flatnonzero(states.alive).tolist()
            self._admit(self._warm_up(files.warm_up))
            self._write()
            self._read_signals()
            self._number_routes()
        # Vehicles placed before the reset are not yet in SUMO.
        self._take_snapshot([slot for slot in self._kept_clear if slot not in self._ids])
        self._has_begun = True

    def step(self) -> None:
        """Advance by one step; the rows of others hold their pose at its end already."""
        library = self._library
        self._check_begun()
        with library.errors("failed in mid-run"):
            entering = self._follow_others() if _snapshot(self._states) != self._last_snapshot else []
            self._shadows.place()
            library.simulation.step(0.0)
            self._shadows.settle()
            if arrived := library.simulation.getArrivedIDList():
                self._dismiss(arrived)
            if departed := library.simulation.getDepartedIDList():
                self._admit(departed)
            self._kept_clear = []
            self._write()
            self._read_signals()
            self._number_routes()
        # They are shadows until the next step.
        self._take_snapshot(entering)

    def can_accept(self, slot: int) -> bool:
        """Return whether SUMO could drive on with a vehicle of another: it must stand on a lane."""
        if slot not in self._shadows:
            return True
        with self._library.errors("failed to read a position"):
            return bool(self._library.vehicle.getLaneID(self._ids[slot]))

    def route(self, slot: int) -> tuple[str, ...]:
        """Return the edges that a vehicle has yet to drive, its own first; for a shadow, as SUMO believes."""
        self._check_begun()
        if slot not in self._ids:
            raise TrafficError(f"slot {slot} holds no vehicle that SUMO knows", place="traffic")
        with self._library.errors("failed to read a route"):
            return self._library.route_ahead(self._ids[slot])

    def close(self) -> None:
        """End the simulation and give the library back."""
        self._library.close()

    def _check_begun(self) -> None:
        self._library.check_open()
        if not self._has_begun:
            raise TrafficError("no episode has begun", place="traffic", remedy="call reset first")

    def _warm_up(self, duration: float) -> list[str]:
        """Run the warm-up [s]; return the departed vehicles.

        Vehicles that are already in the world are inserted in the last step, so that SUMO's drivers react to
        them from the first step of the episode.
        """
        library, dt = self._library, self._world.dt
        entering = self._kept_clear if duration > dt else []
        departed: list[str] = []
        if duration > 0 and entering:
            library.simulation.step(duration - dt)
            departed += library.simulation.getDepartedIDList()
            for slot in entering:
                self._enter(slot)
            self._shadows.place()
        if duration > 0:
            library.simulation.step(duration)
            departed += library.simulation.getDepartedIDList()
        if entering:
            self._shadows.settle()
        return departed

    def _start(self, files: TrafficFiles, seed: int) -> None:
        place = str((files.routes or (files.net,))[0])
        options = [*sumo_options(files, seed, self._world.dt), "--max-num-vehicles", str(self._limit)]
        self._library.start(options, place)

    def _read_map(self, roads: LaneGraph) -> None:
        self.signals = self._world.signals[self._row, : len(roads.lane_ids)]
        self.signals[:] = Signal.NONE
        self._lights = [
            (signal, lanes, roads.signal_link[lanes])
            for number, signal in enumerate(roads.signal_ids)
            if len(lanes := np.flatnonzero(roads.signal == number))
        ]

    def _take_snapshot(self, unseen: Sequence[int] = ()) -> None:
        """Note what the vehicles' rows say, except for those slots, which are to be new in the next step."""
        states = self._states
        self._last_snapshot = _snapshot(states)
        if unseen:
            owner = states.owner.copy()
            owner[unseen] = Owner.NOBODY
            self._last_snapshot = self._last_snapshot._replace(owner=owner.tobytes())

    def _follow_others(self) -> list[int]:
        """Bring SUMO in line with the rows; return the slots of traffic that SUMO has yet to take over."""
        entering, states = [], self._states
        is_other, is_new, is_rerouted = (
            column != np.frombuffer(before, column.dtype)
            for column, before in zip(
                (states.owner, states.generation, states.route), self._last_snapshot, strict=True
            )
        )
        for slot in np.flatnonzero(is_new | is_other | is_rerouted).tolist():
            owner = states.owner[slot]
            if slot in self._ids and (is_new[slot] or owner == Owner.NOBODY):
                self._remove(slot)
            if owner == Owner.NOBODY:
                continue
            if slot not in self._ids:
                self._enter(slot)
                (entering if owner == self._owner else self._kept_clear).append(slot)
            elif owner == self._owner:
                if slot in self._shadows:
                    self._take_back(slot)
            else:
                self._lead(slot, is_rerouted=bool(is_rerouted[slot]))
        return entering

    def _lead(self, slot: int, *, is_rerouted: bool) -> None:
        """Lead the vehicle in a slot as a shadow, on the route in its row if others have written one."""
        if slot not in self._shadows:
            del self._driven[self._ids[slot]]
            self._shadows.take_over(slot, self._ids[slot])
        if is_rerouted and (route := self._planned(slot)):
            self._shadows.set_route(slot, route)

    def _planned(self, slot: int) -> tuple[str, ...]:
        """Return the edges of the route in a vehicle's row, () without one."""
        number = int(self._states.route[slot])
        if number < 0:
            return ()
        names = self._roads.edge_ids
        return tuple(names[edge] for edge in self._world.routes.edges(self._row, number).tolist())

    def _number_routes(self) -> None:
        """Number the routes of SUMO's vehicles that have none."""
        slot = -1
        while (slot := self._next_unplanned(self._owner, slot + 1)) >= 0:
            # One that others have just admitted may not have come to SUMO so far.
            if name := self._ids.get(slot):
                edges = map(self._roads.edge_number, self._library.route_ahead(name))
                self._states.route[slot] = self._world.routes.number(self._row, edges)

    def _take_back(self, slot: int) -> None:
        if self._shadows.hand_back(slot):
            self._driven[self._ids[slot]] = slot
        else:
            self._remove(slot)
            self._world.registry.dismiss(self._row, slot)

    def _enter(self, slot: int) -> None:
        name = f"slot-{slot}-{self._states.generation[slot]}"
        self._shadows.create(slot, name, self._planned(slot))
        self._ids[slot] = name

    def _remove(self, slot: int) -> None:
        """Take a vehicle out of SUMO."""
        name = self._ids.pop(slot)
        self._library.vehicle.remove(name)
        self._shadows.forget(slot)
        self._driven.pop(name, None)

    def _dismiss(self, names: Iterable[str]) -> None:
        """Take vehicles that SUMO has removed out of the world."""
        for name in names:
            # Those that were removed for others are gone already.
            if (slot := self._driven.pop(name, None)) is not None:
                del self._ids[slot]
                self._shadows.forget(slot)
                self._world.registry.dismiss(self._row, slot)

    def _admit(self, departed: Iterable[str]) -> None:
        """Let vehicles into the world in the order of departure, except where the place is kept clear."""
        vehicle = self._library.vehicle
        present = set(vehicle.getIDList()).difference(self._ids.values())
        names = [name for name in departed if name in present and name not in self._shadows.proxies]
        blocking = self._in_the_way(names)
        for name in names:
            # SUMO counts vehicles inserted by `moveToXY` one step late, so one vehicle too many may depart.
            if name in blocking or len(self._ids) >= self._limit:
                vehicle.remove(name)
                continue
            kind = _KINDS.get(vehicle.getVehicleClass(name), VehicleKind.PASSENGER)
            size = vehicle.getLength(name), vehicle.getWidth(name)
            slot = self._world.registry.admit(self._row, name, self._owner, kind, *size)
            self._driven[name] = slot
            self._ids[slot] = name
            self._is_new[slot] = True
        self.is_full |= len(self._ids) >= self._limit

    def _in_the_way(self, names: Sequence[str]) -> list[str]:
        """Return those of SUMO's vehicles that are in a place to be kept clear."""
        states = self._states
        slots = [slot for slot in self._kept_clear if states.alive[slot]]
        if not names or not slots:
            return []
        vehicle = self._library.vehicle
        size = np.array([(vehicle.getLength(name), vehicle.getWidth(name)) for name in names])
        front = np.array([*map(vehicle.getPosition, names)])
        heading = heading_from_compass(np.array([*map(vehicle.getAngle, names)]))
        position = centre_of(front, heading, size[:, 0])
        kept = np.stack([states.length[slots], states.width[slots]], -1) + 2 * np.array(SPAWN_MARGIN)
        overlap = boxes_overlap(
            position[:, None],
            heading[:, None],
            size[:, None],
            states.position[slots],
            states.heading[slots],
            kept,
        )
        return [names[row] for row in np.flatnonzero(overlap.any(axis=1)).tolist()]

    def _write(self) -> None:
        """Fill the rows that SUMO drives.

        One call per value and vehicle, all in one pass without Python's interpreter, costs less in this
        process than subscriptions, which build a dictionary for every vehicle (`perf/traffic.py`).
        """
        driven, count = self._driven, len(self._driven)
        if not count:
            return
        vehicle = self._library.vehicle
        ones = (vehicle.getAngle, vehicle.getSpeed, vehicle.getAcceleration, vehicle.getAllowedSpeed)
        pairs = chain.from_iterable(map(vehicle.getPosition, driven))
        values = np.fromiter(chain(pairs, *(map(one, driven) for one in ones)), np.float64, 6 * count)
        # Where a vehicle is on the map is for the simulation to say, of all vehicles alike.
        self._fill(np.fromiter(driven.values(), np.intp, count), values)

    def _read_signals(self) -> None:
        state_of = self._library.trafficlight.getRedYellowGreenState
        for signal, lanes, links in self._lights:
            self.signals[lanes] = _LIGHTS[np.frombuffer(state_of(signal).encode(), np.uint8)[links]]
