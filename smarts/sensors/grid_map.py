"""Pictures from above: what the sensors that draw some have in common."""

from __future__ import annotations

import math
from collections import namedtuple
from typing import ClassVar, NamedTuple

import numpy as np

from smarts.arrays import Pixels
from smarts.geometry.compiling import kernel
from smarts.geometry.raster import paint_box, place_in_view
from smarts.sensors.bounds import FARTHEST, LARGEST_BOX, clipped, clipped_above
from smarts.sensors.protocol import KernelSensor, Readings, Seen, Triple
from smarts.types.interface import Field
from smarts.types.vehicles import VehicleStates


class GridMapMetadata(NamedTuple):
    """How to find places in a picture."""

    resolution: float
    """Side of a pixel [m]."""
    width: int
    height: int
    camera_position: Triple
    """Position of the picture's middle in the map [m]."""
    camera_heading: float
    """Which way the upper edge is [rad]."""


class GridMap(NamedTuple):
    """A picture from above."""

    metadata: GridMapMetadata
    data: Pixels
    """Shape (height, width, channels)."""


GridOut = namedtuple("GridOut", "data resolution")
"""The arrays of a picture's fields."""


def grid_fields(height: int, width: int, channels: int, most: int, meaning: str) -> tuple[Field, ...]:
    """Return the fields of a picture whose pixels are 0 to `most`."""
    return (
        Field("data", (height, width, channels), np.uint8, 0, most, "", meaning),
        Field("resolution", (), np.float32, 0, FARTHEST, "m", "side of a pixel"),
    )


class PictureSensor(KernelSensor):
    """A sensor whose readings are a picture from above."""

    arrays: ClassVar[type] = GridOut

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> GridMap:
        """Return the picture."""
        height, width, _ = readings["data"].shape
        ego, resolution = seen.ego_vehicle_state, float(readings["resolution"])
        metadata = GridMapMetadata(resolution, width, height, ego.position, float(ego.heading))
        return GridMap(metadata, readings["data"])


@kernel
def viewer(vehicles: VehicleStates, b: int, own: int) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] of a picture's middle."""
    x, y = clipped(vehicles.position[b, own, 0], FARTHEST), clipped(vehicles.position[b, own, 1], FARTHEST)
    return x, y, clipped(vehicles.heading[b, own], math.pi)


@kernel
def paint_vehicle(
    vehicles: VehicleStates,
    b: int,
    v: int,
    x: float,
    y: float,
    heading: float,
    resolution: float,
    colour: Pixels,
    view: Pixels,
) -> None:
    """Paint a vehicle's box into the view of a viewer at x, y [m] with a heading [rad]."""
    position = vehicles.position
    ahead, aside = place_in_view(position[b, v, 0], position[b, v, 1], x, y, heading)
    paint_box(
        view,
        resolution,
        ahead,
        aside,
        clipped(vehicles.heading[b, v], math.pi) - heading,
        clipped_above(vehicles.length[b, v], LARGEST_BOX),
        clipped_above(vehicles.width[b, v], LARGEST_BOX),
        colour,
    )
