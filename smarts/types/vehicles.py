"""Vehicles as arrays: row *i* of every array is the same vehicle."""

from __future__ import annotations

import enum
from typing import Any, NamedTuple

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.types import columns


class Owner(enum.IntEnum):
    """Which provider moves a vehicle: a number in the simulation's table of providers.

    These are the numbers that every simulation has; further traffic providers get the numbers after them, so
    a provider takes for its own only the rows that carry its own number.
    """

    NOBODY = 0
    TRAFFIC = 1
    """The traffic engine of the scenario, usually SUMO."""
    AGENT = 2
    """The vehicle provider, which carries out the actions of agents."""


class VehicleKind(enum.IntEnum):
    """What a vehicle is; names are those of `TrafficActor.vehicle_type`, which does not have pedestrians."""

    PASSENGER = 0
    BUS = 1
    COACH = 2
    TRUCK = 3
    TRAILER = 4
    MOTORCYCLE = 5
    BICYCLE = 6
    PEDESTRIAN = 7


STANDING = 0.5
"""A slower vehicle stands [m/s]."""
NONE_IS_MINUS_ONE = ("lane", "route", "next_edge", "standing_since")
"""Names of the arrays that are -1, not 0, where there is no vehicle."""


class VehicleStates(NamedTuple):
    """The vehicles of one simulation (or of B simulations) at one instant.

    Every array has the leading shape `(..., V)`, V the capacity in slots; a slot whose `alive` is false
    holds no vehicle: those in `NONE_IS_MINUS_ONE` are -1, its other values but the generation are zero. The
    arrays are written in place by the step and are to be read only elsewhere.
    """

    alive: Bools
    """Whether the slot holds a vehicle."""
    generation: Ints
    """Counts the vehicles that used the slot; (slot, generation) identifies a vehicle."""
    owner: Bytes
    """An `Owner`, or the number of a further provider."""
    kind: Bytes
    """A `VehicleKind`."""
    position: Floats
    """Centre of the footprint in the map frame [m], shape (..., V, 2)."""
    height: Floats
    """Height of the road under the centre [m]. NaN, unknown, until a new vehicle is matched, unless its
    provider knows it."""
    heading: Floats
    """Counter-clockwise from +x, in (-pi, pi] [rad]."""
    speed: Floats
    """Speed along the heading [m/s]."""
    acceleration: Floats
    """Acceleration along the heading [m/s^2]."""
    length: Floats
    """Length of the footprint [m]."""
    width: Floats
    """Width of the footprint [m]."""
    lane: Ints
    """Index into the map's lanes: the one that the vehicle is on, or the nearest; -1 if unknown."""
    lane_position: Floats
    """Arc length of the vehicle's centre along its lane [m]; below 0 while it is on the lane before."""
    desired_speed: Floats
    """The driver's speed here on a free road [m/s]."""
    lane_offset: Floats
    """Offset of the vehicle's centre from its lane's centreline, positive to the left [m]."""
    lateral_speed: Floats
    """Speed across the heading, positive to the left [m/s]; 0 for vehicles that do not slip."""
    lateral_acceleration: Floats
    """Acceleration across the heading, positive to the left [m/s^2]."""
    yaw_rate: Floats
    """Counter-clockwise [rad/s]."""
    yaw_acceleration: Floats
    """Counter-clockwise [rad/s^2]."""
    route: Ints
    """Number of the planned route among those of its simulation, -1 where none is known."""
    next_edge: Ints
    """Edge of the map that the vehicle takes after its present one by its planned route: what its turn signal
    shows; inside a junction the edge behind it; -1 if unknown, or at the route's end."""
    standing_since: Ints
    """Step of the episode since which the vehicle stands (below `STANDING`), -1 while it moves."""
    home: Bytes
    """The provider that gets the vehicle back when its agent is done; NOBODY: it is removed."""

    @classmethod
    def allocate(cls, *shape: int) -> VehicleStates:
        """Return empty slots of the given shape; the last axis is V."""
        return columns.allocate(cls, shape, NONE_IS_MINUS_ONE, {"position": (2,)})

    @property
    def capacity(self) -> int:
        """V, the number of slots."""
        return self.alive.shape[-1]

    def clear(self, slot: int | slice | tuple[Any, ...] = slice(None)) -> None:
        """Empty slots, given by an index of the arrays; generations stay, so that none is issued twice."""
        for name, column in self._asdict().items():
            if name != "generation":
                column[slot] = -1 if name in NONE_IS_MINUS_ONE else 0

    def of(self, row: int) -> VehicleStates:
        """Return views of the slots of one simulation of a batch."""
        return VehicleStates._make(column[row] for column in self)
