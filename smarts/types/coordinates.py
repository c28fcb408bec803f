"""Points, headings, poses and sizes as small values, for scenario files and observations.

Kernels work on arrays instead; these are for the few places where people read and write single values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.frames import heading_from_compass, wrap_angle


class Dimensions(NamedTuple):
    """Length, width and height of a box [m]."""

    length: float
    width: float
    height: float

    @property
    def as_lwh(self) -> tuple[float, float, float]:
        """Length, width, height [m]."""
        return self.length, self.width, self.height


class Point(NamedTuple):
    """A position in the map frame, x east, y north, z up [m]."""

    x: float
    y: float
    z: float = 0.0

    @classmethod
    def from_np_array(cls, array: Floats) -> Point:
        """Return the point of an array of two or three coordinates."""
        return cls(*(float(coordinate) for coordinate in array))

    @property
    def as_np_array(self) -> Floats:
        """The coordinates, shape (3,)."""
        return np.array(self, np.float64)


class RefLinePoint(NamedTuple):
    """A position relative to a lane's centreline."""

    s: float
    """Arc length from the lane's begin [m]."""
    t: float = 0.0
    """Offset to the left of the centreline [m]."""
    h: float = 0.0
    """Above the road's surface [m]."""


class Heading(float):
    """An angle counter-clockwise from +x, wrapped to (-pi, pi] [rad].

    The original measures from north; all of this project measures from east.
    """

    def __new__(cls, radians: float = 0.0) -> Heading:
        """Wrap an angle [rad]."""
        return super().__new__(cls, wrap_angle(radians))

    @classmethod
    def from_sumo(cls, degrees: float) -> Heading:
        """Return the heading of SUMO's angle, which is clockwise from north in degrees."""
        return cls(heading_from_compass(degrees))

    @property
    def as_sumo(self) -> float:
        """SUMO's angle, clockwise from north, in [0, 360) degrees."""
        return (90.0 - math.degrees(self)) % 360.0

    def relative_to(self, other: float) -> Heading:
        """Return how far this heading is to the left of another."""
        return Heading(self - other)

    def direction_vector(self) -> Floats:
        """Return the unit vector that points this way, shape (2,)."""
        return np.array([math.cos(self), math.sin(self)])

    def __repr__(self) -> str:
        return f"Heading({float(self)!r})"


@dataclass(frozen=True)
class Pose:
    """Where something is and which way it faces."""

    point: Point
    """Its centre [m]."""
    heading: Heading
    """Its direction [rad]."""

    @classmethod
    def from_front_bumper(cls, bumper: Point, heading: float, length: float) -> Pose:
        """Return the pose of a vehicle of `length` [m] whose front bumper's middle is at `bumper`."""
        back_x, back_y = math.cos(heading) * length / 2, math.sin(heading) * length / 2
        return cls(Point(bumper.x - back_x, bumper.y - back_y, bumper.z), Heading(heading))
