"""Traffic of one simulation, driven by SUMO in this process.

Without agents, it equals the result of `sumo` with the same files, options, seed and step length, but for the
headings that `sumo_lean` limits.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from smarts.errors import TrafficError
from smarts.geometry.binding import bind
from smarts.providers.sumo_arrivals import SumoArrivals
from smarts.providers.sumo_departures import find_blocking
from smarts.providers.sumo_driven import DrivenRows
from smarts.providers.sumo_fading import FadingPoses
from smarts.providers.sumo_gate import SumoGate
from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_rows import next_unplanned
from smarts.providers.sumo_shadows import SumoShadows
from smarts.providers.sumo_signals import SumoSignals
from smarts.roads.lane_graph import LaneGraph
from smarts.types.traffic import TrafficFiles
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleKind, VehicleStates
from smarts.types.world import World

_KINDS = {kind.name.lower(): kind for kind in VehicleKind}
_KINDS |= {"delivery": VehicleKind.TRUCK, "moped": VehicleKind.MOTORCYCLE}
"""`VehicleKind` of SUMO's vehicle classes; others are passenger cars."""

_AGAIN = re.compile(r"-again-\d+$")
"""Suffix of a replaced vehicle's SUMO id, behind its first id: the step."""


class _Snapshot(NamedTuple):
    """Columns of the vehicles as of the last step; bytes compare faster than arrays of this size."""

    owner: bytes
    generation: bytes
    route: bytes


def _snapshot(states: VehicleStates) -> _Snapshot:
    return _Snapshot(states.owner.tobytes(), states.generation.tobytes(), states.route.tobytes())


def sumo_options(files: TrafficFiles, seed: int, dt: float) -> list[str]:
    """Return SUMO's command line; simulations with equal command lines have identical traffic."""
    options = ["--net-file", str(files.net), "--seed", str(seed), "--step-length", repr(dt)]
    if files.routes:
        options += ["--route-files", ",".join(map(str, files.routes))]
    if files.additional:
        options += ["--additional-files", ",".join(map(str, files.additional))]
    options += [text for name, value in files.options for text in (f"--{name}", value)]
    # SUMO would change the integration for all vehicles by itself, once some type's drivers do not decide
    # in every step; it rounds their reaction time down to whole steps.
    if files.reaction_time is not None and "step-method.ballistic" not in dict(files.options):
        decides_later = round(1000 * files.reaction_time) // round(1000 * dt) > 1
        options += ["--step-method.ballistic", "true" if decides_later else "false"]
    # Lane changes take 3 s instead of one step; vehicles are not removed from jams and after collisions.
    options += ["--lanechange.duration", "3", "--time-to-teleport", "-1"]
    options += ["--collision.action", "none", "--collision.check-junctions", "true"]
    return [*options, "--no-step-log", "--no-warnings", "--xml-validation", "never"]


class SumoTraffic:
    """One simulation's traffic: SUMO drives the vehicles with its owner number and reacts to all others.

    When another provider becomes a vehicle's owner, the vehicle is led as a shadow from the next step on;
    when SUMO becomes its owner again, SUMO drives it from its current pose and speed. It keeps its SUMO id
    unless it is taken over during a lane change (`SumoShadows.replace`). A vehicle that another provider
    admits is added to SUMO, and one that it dismisses is removed. A vehicle that is handed to SUMO off all
    lanes leaves the world. SUMO's drivers expect another provider's vehicle to follow its `route`.

    At the vehicle limit, SUMO delays departures until a vehicle has left (`is_full`), so an episode depends
    on the limit only if the limit is too small.

    Args:
        world: The world; one simulation of it is read and written.
        row: The simulation.
        owner: SUMO's owner number.
        step: Duration of SUMO's step [s], a multiple of the world's, by default equal to it. Within a longer
            one, vehicles move evenly between SUMO's poses. SUMO's drivers then get other vehicles' poses as
            predicted for the end of its step.

    Attributes:
        is_full: Whether the limit has delayed departures in this episode.

    Raises:
        TrafficError: SUMO failed, in any method; other simulations continue, and the next `reset` works.
    """

    def __init__(self, world: World, row: int, owner: int = Owner.TRAFFIC, step: float | None = None) -> None:
        self._dt = world.dt if step is None else step
        if abs(1000.0 * self._dt - round(1000.0 * self._dt)) > 1e-6:
            raise TrafficError(
                f"a step of {self._dt} s, while SUMO counts whole milliseconds",
                place="dt",
                remedy=f"give {max(round(1000.0 * self._dt), 1) / 1000.0:g} s, or the traffic engine Native",
            )
        self.is_full = False
        self._world, self._row, self._owner = world, row, int(owner)
        # Create the views once: creating them takes as long as writing the vehicles.
        self._states = states = world.vehicles.of(row)
        self._library = SumoLibrary()
        self._signals = SumoSignals(self._library, world.signals[row])
        self._shadows = SumoShadows(self._library, states, self._dt)
        self._gate = SumoGate(self._library, world, row)
        self._arrivals, self._fading = SumoArrivals(), FadingPoses(world, row)
        self._ids: dict[int, str] = {}
        self._driven: dict[str, int] = {}
        self._kept_clear: list[int] = []
        self._limit = 0
        self._steps = round(self._dt / world.dt)
        self._done = 0  # steps of the world in SUMO's present step
        self._rows = DrivenRows(self._library, states, self._owner, world.dt, self._steps)
        self._next_unplanned = bind(next_unplanned, states)

    def reset(self, files: TrafficFiles, seed: int, roads: LaneGraph, limit: int | None = None) -> None:
        """Begin an episode: load, warm up, and admit the traffic to the world.

        Vehicles that are in the world already, such as egos, are kept clear of traffic.

        Args:
            files: The traffic.
            seed: SUMO's seed, in [0, 2^31).
            roads: The lanes of the net in `files`.
            limit: Maximum number of vehicles in SUMO, those of other providers included; by default the
                number of slots.
        """
        self._roads, states = roads, self._states
        self._shadows.reset(roads)
        self._gate.reset(roads)
        self._arrivals = SumoArrivals(files.routes)
        self._fading.clear()
        self._ids.clear()
        self._driven.clear()
        self._limit = states.capacity if limit is None else limit
        self._rows.reset(roads)
        self._done = 0
        self.is_full = False
        self._signals.reset(roads)
        self._start(files, seed)
        with self._library.errors("failed while the traffic warmed up"):
            self._kept_clear = np.flatnonzero(states.alive).tolist()
            self._admit(self._warm_up(files.warm_up, float(dict(files.options).get("begin", 0.0))))
            self._rows.read(self._driven)
            self._rows.write(self._steps)
            self._signals.read()
            self._number_routes()
        # Vehicles that were in the world before the reset are not in SUMO yet.
        self._take_snapshot([slot for slot in self._kept_clear if slot not in self._ids])

    def step(self) -> None:
        """Advance by one step; other providers' vehicles have their poses of the step's end already."""
        if 0 < self._done < self._steps - 1:
            self._done += 1
            self._rows.write(self._done)
            return
        with self._library.errors("failed in mid-run"):
            if not self._done:
                self._step_sumo()
            self._done += 1
            self._rows.write(self._done)
            if self._done == self._steps:
                self._signals.read()
                self._done = 0

    def _step_sumo(self) -> None:
        """Advance SUMO by one of its steps."""
        simulation = self._library.simulation
        entering = self._apply_changes() if _snapshot(self._states) != self._last_snapshot else []
        self._shadows.place((self._steps - 1) * self._world.dt)
        simulation.step(0.0)
        self._shadows.settle()
        for slot in self._shadows.lost:
            self._replace(slot)
        if arrived := simulation.getArrivedIDList():
            self._dismiss(arrived)
        if departed := simulation.getDepartedIDList():
            self._admit(departed)
        self._kept_clear = []
        self._rows.read(self._driven)
        self._fading.apply(self._shadows.returned)
        self._number_routes()
        # Entering vehicles are shadows in this step; SUMO drives them from the next step on.
        self._take_snapshot(entering)

    def can_accept(self, slot: int) -> Refusal:
        """Return whether SUMO can take over another provider's vehicle without a jump; see `SumoGate`."""
        if slot not in self._shadows:
            return Refusal.NONE
        with self._library.errors("failed to read a position"):
            return self._gate.refusal(slot, self._shadows[slot])

    def can_release(self, slot: int) -> Refusal:
        """Return whether an agent can take over a vehicle that SUMO drives; see `SumoGate`."""
        if (name := self._ids.get(slot)) not in self._driven:
            return Refusal.NONE
        with self._library.errors("failed to read a position"):
            return self._gate.refusal_to_give(slot, name)

    def close(self) -> None:
        """End the simulation and free its copy of libsumo."""
        self._library.close()

    def _warm_up(self, duration: float, begin: float) -> list[str]:
        """Run the warm-up of `duration` [s] from SUMO's time `begin` [s]; return SUMO ids of what departed.

        Vehicles that are already in the world are inserted in the last warm-up step, so that SUMO's drivers
        react to them from the first step of the episode.
        """
        library, dt = self._library, self._dt
        entering = self._kept_clear if duration > dt else []
        departed: list[str] = []
        if duration > 0 and entering:
            library.simulation.step(begin + duration - dt)
            departed += library.simulation.getDepartedIDList()
            for slot in entering:
                self._enter(slot)
            self._shadows.place()
        if duration > 0:
            library.simulation.step(begin + duration)
            departed += library.simulation.getDepartedIDList()
        if entering:
            self._shadows.settle()
        return departed

    def _start(self, files: TrafficFiles, seed: int) -> None:
        place = str((files.routes or (files.net,))[0])
        options = [*sumo_options(files, seed, self._dt), "--max-num-vehicles", str(self._limit)]
        self._library.start(options, place)

    def _take_snapshot(self, unseen: Sequence[int] = ()) -> None:
        """Store the vehicles' columns, except for slots `unseen`, which count as changed in the next step."""
        states = self._states
        self._last_snapshot = _snapshot(states)
        if unseen:
            owner = states.owner.copy()
            owner[unseen] = Owner.NOBODY
            self._last_snapshot = self._last_snapshot._replace(owner=owner.tobytes())

    def _apply_changes(self) -> list[int]:
        """Apply changes of the world's rows to SUMO; return the new slots that SUMO is to drive."""
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
                self._lead_shadow(slot, is_rerouted=bool(is_rerouted[slot]))
        return entering

    def _lead_shadow(self, slot: int, *, is_rerouted: bool) -> None:
        """Lead a slot's vehicle as a shadow, with the route in its row if another provider has changed it."""
        if slot not in self._shadows:
            name = self._ids[slot]
            del self._driven[name]
            self._fading.drop(slot)
            if self._library.vehicle.getLateralSpeed(name):
                # It changes lanes.
                self._replace(slot)
            else:
                self._shadows.take_over(slot, name)
        if is_rerouted and (route := self._planned(slot)):
            self._shadows.set_route(slot, route)

    def _replace(self, slot: int) -> None:
        """Make a slot's vehicle a shadow under a new name in SUMO."""
        name = self._ids[slot]
        first = _AGAIN.sub("", name)
        self._ids[slot] = f"{first}-again-{self._world.step[self._row]}"
        self._shadows.replace(slot, name, self._ids[slot], self._arrivals.of(first))

    def _planned(self, slot: int) -> tuple[str, ...]:
        """Return the edges of the route in a vehicle's row, or () if it has none."""
        number = int(self._states.route[slot])
        if number < 0:
            return ()
        names = self._roads.edge_ids
        return tuple(names[edge] for edge in self._world.routes.edges(self._row, number).tolist())

    def _number_routes(self) -> None:
        """Write the routes of SUMO's vehicles whose rows have none."""
        slot = -1
        while (slot := self._next_unplanned(self._owner, slot + 1)) >= 0:
            # A vehicle that another provider has just admitted may not be in SUMO yet.
            if name := self._ids.get(slot):
                edges = map(self._roads.edge_number, self._library.route_ahead(name))
                self._states.route[slot] = self._world.routes.number(self._row, edges)

    def _take_back(self, slot: int) -> None:
        if self._shadows.hand_back(slot):
            self._driven[self._ids[slot]] = slot
            self._fading.begin(slot)
        else:
            self._remove(slot)
            self._world.registry.dismiss(self._row, slot)

    def _enter(self, slot: int) -> None:
        name = f"slot-{slot}-{self._states.generation[slot]}"
        self._shadows.create(slot, name, self._planned(slot))
        self._ids[slot] = name

    def _remove(self, slot: int) -> None:
        """Remove a vehicle from SUMO."""
        name = self._ids.pop(slot)
        self._library.vehicle.remove(name)
        self._shadows.forget(slot)
        self._fading.drop(slot)
        self._driven.pop(name, None)

    def _dismiss(self, names: Iterable[str]) -> None:
        """Remove vehicles that have arrived in SUMO from the world."""
        for name in names:
            # Vehicles that other providers dismissed are gone already.
            if (slot := self._driven.pop(name, None)) is not None:
                del self._ids[slot]
                self._shadows.forget(slot)
                self._fading.drop(slot)
                self._world.registry.dismiss(self._row, slot)

    def _admit(self, departed: Iterable[str]) -> None:
        """Admit departed vehicles to the world in order; remove those that are too close to others'."""
        vehicle = self._library.vehicle
        present = set(vehicle.getIDList()).difference(self._ids.values())
        names = [name for name in departed if name in present and name not in self._shadows.proxies]
        blocking = find_blocking(self._library, self._states, names, self._kept_clear, self._shadows)
        for name in names:
            # SUMO counts vehicles inserted by `moveToXY` one step late, so one vehicle too many may depart.
            if name in blocking or len(self._ids) >= self._limit:
                vehicle.remove(name)
                continue
            kind = _KINDS.get(vehicle.getVehicleClass(name), VehicleKind.PASSENGER)
            size = vehicle.getLength(name), vehicle.getWidth(name)
            slot = self._world.registry.admit(self._row, name, self._owner, kind, *size)
            self._states.height[slot] = vehicle.getPosition3D(name)[2]
            self._driven[name] = slot
            self._ids[slot] = name
            self._rows.note_new(slot)
        self.is_full |= len(self._ids) >= self._limit
