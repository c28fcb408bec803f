"""Where recorded vehicles are when, and the paths that they drive, as arrays for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints


class Paths(NamedTuple):
    """P paths, with N samples and M points; a path of lanes has no samples."""

    kind: Bytes
    """A `VehicleKind`, shape (P,)."""
    length: Floats
    """Length of the footprint [m], shape (P,)."""
    width: Floats
    """Width of the footprint [m], shape (P,)."""
    headway: Floats
    """Time headway that the driver keeps [s], shape (P,)."""
    begin: Floats
    """Time of the first sample [s], infinite for a path of lanes, shape (P,)."""
    end: Floats
    """Time of the last sample [s], minus infinity for a path of lanes, shape (P,)."""
    is_cut: Bools
    """Whether the path continues along lanes after the last sample, shape (P,)."""
    sample: Ints
    """First sample of each path, and N, shape (P + 1,)."""
    point: Ints
    """First point of each path, and M, shape (P + 1,)."""
    t: Floats
    """Time since the recording's first sample [s], shape (N,), as are the following."""
    x: Floats
    """Centre of the footprint [m]."""
    y: Floats
    """[m]"""
    turn: Floats
    """Heading without jumps of a whole turn [rad]."""
    speed: Floats
    """As recorded [m/s]."""
    s: Floats
    """Arc length along the path [m], which never falls."""
    point_x: Floats
    """[m], shape (M,), as are the following; a path has two points or more."""
    point_y: Floats
    """[m]"""
    point_turn: Floats
    """Heading of a vehicle there, without jumps of a whole turn [rad]."""
    point_s: Floats
    """Arc length [m]."""
    point_pace: Floats
    """How fast a vehicle drives there on a free road [m/s]."""

    def points(self, path: int) -> Floats:
        """Return the points x, y, heading, arc length of a path, shape (n, 4)."""
        rows = slice(self.point[path], self.point[path + 1])
        columns = self.point_x, self.point_y, self.point_turn, self.point_s
        return np.column_stack([column[rows] for column in columns])

    @classmethod
    def empty(cls) -> Paths:
        """Return no paths."""
        kinds = {"kind": np.int8, "is_cut": np.bool_, "sample": np.int32, "point": np.int32}
        empty = (np.zeros(int(name in ("sample", "point")), kinds.get(name, float)) for name in cls._fields)
        return cls._make(empty)

    def joined(self, more: Paths) -> Paths:
        """Return these paths and more behind them."""
        behind = more._replace(
            sample=self.sample[-1] + more.sample[1:], point=self.point[-1] + more.point[1:]
        )
        return Paths._make(np.concatenate(each) for each in zip(self, behind, strict=True))
