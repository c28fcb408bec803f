"""Vehicles as arrays: row *i* of every array is the same vehicle."""

from __future__ import annotations

import dataclasses
import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


class Owner(enum.IntEnum):
    """Who decides how a vehicle moves."""

    NOBODY = 0
    TRAFFIC = 1
    AGENT = 2


class VehicleKind(enum.IntEnum):
    """What a vehicle is; names are those of `TrafficActor.vehicle_type`."""

    PASSENGER = 0
    BUS = 1
    COACH = 2
    TRUCK = 3
    TRAILER = 4
    MOTORCYCLE = 5


@dataclass(frozen=True)
class VehicleStates:
    """The vehicles of one simulation (or of B simulations) at one instant.

    Every array has the leading shape `(..., V)`, V the capacity in slots; a slot whose `alive` is false
    holds no vehicle and its other values are zero. The arrays are written in place by the step and are
    to be read only elsewhere.
    """

    alive: NDArray[np.bool_]
    """Whether the slot holds a vehicle."""
    generation: NDArray[np.int32]
    """How often the slot has been given out; (slot, generation) names a vehicle for good."""
    owner: NDArray[np.int8]
    """An `Owner`."""
    kind: NDArray[np.int8]
    """A `VehicleKind`."""
    position: NDArray[np.float64]
    """Centre of the footprint in the map frame [m], shape (..., V, 2)."""
    heading: NDArray[np.float64]
    """Counter-clockwise from +x, in (-pi, pi] [rad]."""
    speed: NDArray[np.float64]
    """Along the heading [m/s]."""
    acceleration: NDArray[np.float64]
    """Along the heading [m/s^2]."""
    length: NDArray[np.float64]
    """Of the footprint [m]."""
    width: NDArray[np.float64]
    """Of the footprint [m]."""
    lane: NDArray[np.int32]
    """Index into the map's lanes, -1 where the vehicle is on none."""
    lane_position: NDArray[np.float64]
    """Arc length of the vehicle's centre along its lane [m]; below 0 while it is on the lane before."""
    desired_speed: NDArray[np.float64]
    """What the driver would drive here if the road were free [m/s]."""

    @classmethod
    def allocate(cls, *shape: int) -> VehicleStates:
        """Return empty slots of the given shape; the last axis is V."""

        def zeros(dtype: type) -> NDArray:
            return np.zeros(shape, dtype)

        return cls(
            alive=zeros(np.bool_),
            generation=zeros(np.int32),
            owner=zeros(np.int8),
            kind=zeros(np.int8),
            position=np.zeros((*shape, 2)),
            heading=zeros(np.float64),
            speed=zeros(np.float64),
            acceleration=zeros(np.float64),
            length=zeros(np.float64),
            width=zeros(np.float64),
            lane=np.full(shape, -1, np.int32),
            lane_position=zeros(np.float64),
            desired_speed=zeros(np.float64),
        )

    @property
    def capacity(self) -> int:
        """V, the number of slots."""
        return self.alive.shape[-1]

    def __getitem__(self, index: int) -> VehicleStates:
        """Return views of one simulation's slots out of a batch."""
        return VehicleStates(*(getattr(self, field.name)[index] for field in dataclasses.fields(self)))
