"""The rows of the vehicles that SUMO drives: SUMO's values, or poses between those of two of its steps."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain

import numpy as np

from smarts.geometry.binding import bind
from smarts.providers.sumo_lean import Straightening
from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_rows import Legs, begin_legs, fill_between, fill_rows
from smarts.roads.lane_graph import LaneGraph
from smarts.types.vehicles import VehicleStates


class DrivenRows:
    """Writes the rows of one simulation's vehicles that SUMO drives.

    Args:
        library: The copy of libsumo that runs the simulation.
        states: Vehicles of the simulation.
        owner: SUMO's owner number.
        dt: Duration of the world's step [s].
        steps: Steps of the world in one step of SUMO.
    """

    def __init__(
        self, library: SumoLibrary, states: VehicleStates, owner: int, dt: float, steps: int
    ) -> None:
        self._library, self._steps = library, steps
        self._is_new = np.zeros(states.capacity, np.bool_)
        self._lean = Straightening(library, states, self._is_new)
        if steps == 1:
            self._take = bind(fill_rows, states, self._is_new, dt)
        else:
            legs = Legs.allocate(states.capacity)
            self._take = bind(begin_legs, states, self._is_new, legs)
            self._fill_between = bind(fill_between, states, self._is_new, legs, dt, owner)

    def reset(self, roads: LaneGraph) -> None:
        """Begin an episode on a map."""
        self._is_new[:] = False
        self._lean.reset(roads)

    def note_new(self, slot: int) -> None:
        """Note that a slot's row does not hold its vehicle's last pose."""
        self._is_new[slot] = True

    def read(self, driven: Mapping[str, int]) -> None:
        """Read SUMO's values, after a step of SUMO; the world's steps are in step with SUMO's: write them.

        One call per value and vehicle, in a pass without interpreted code, is faster than subscriptions,
        which build a dictionary for every vehicle (`perf/traffic.py` at commit 63735bac).

        Args:
            driven: Slots of the vehicles by their SUMO ids.
        """
        count = len(driven)
        if not count and self._steps == 1:
            return
        vehicle = self._library.vehicle
        ones = (vehicle.getAngle, vehicle.getSpeed, vehicle.getAcceleration, vehicle.getAllowedSpeed)
        pairs = chain.from_iterable(map(vehicle.getPosition, driven))
        values = np.fromiter(chain(pairs, *(map(one, driven) for one in ones)), np.float64, 6 * count)
        rows = np.fromiter(driven.values(), np.intp, count)
        self._lean.apply(driven, rows, values)
        # The simulation matches all vehicles to lanes itself.
        self._take(rows, values)

    def write(self, step: int) -> None:
        """Write the poses of one of the world's steps within SUMO's, counted from 1."""
        if self._steps > 1:
            self._fill_between(step / self._steps)
