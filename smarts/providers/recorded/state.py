"""The arrays of recorded traffic. Axis letters: B simulations, V slots, T tracks of the longest log."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bytes, Ints
from smarts.providers.native.state import Records
from smarts.recordings.paths import Paths
from smarts.types.vehicles import VehicleStates


class Course(IntEnum):
    """How the engine drives a vehicle."""

    NONE = 0
    """It does not, or not yet."""
    ON_LOG = 1
    """It is where the log has it."""
    FOLLOWS = 2
    """It follows a path, and brakes for what is on it."""


class Entry(IntEnum):
    """How far a track's vehicle has come."""

    TO_COME = 0
    DELAYED = 1
    """It could not enter when it was due."""
    DONE = 2
    """It has entered, or will not."""


SIMULATION = np.dtype(
    [
        # Paths of its log, the last one excluded; the first that is not due, the first that is not done.
        *((name, np.int32) for name in ("first", "last", "next", "oldest")),
        ("begin", np.float64),
        ("reacts", np.bool_),
        ("limit", np.int32),
        ("is_full", np.bool_),
        ("held_back", np.int32),
    ],
    align=True,
)
"""A simulation."""
CAR = np.dtype(
    [
        # A `Course` now, and after the step; the vehicle's generation, its own track, -1 for none, and the
        # path that it follows.
        *((name, np.int32) for name in ("course", "next_course", "generation", "track", "path")),
        # Place along the path; speed after the step.
        *((name, np.float64) for name in ("s", "next_speed")),
        # Where it joined the path: its offset to the left and slope there; along which distance both go to 0.
        *((name, np.float64) for name in ("joined", "offset", "slope", "blend")),
    ],
    align=True,
)
"""What is known of a vehicle that the engine drives, or has driven."""


class Recorded(NamedTuple):
    """All arrays of recorded traffic; replaced in the bound kernels when paths are added."""

    owner: int
    dt: float
    step: Ints
    """Step of each episode, shape (B,)."""
    used: Ints
    """Number of slots in use, shape (B,)."""
    vehicles: VehicleStates
    sims: Records
    """Shape (B,)."""
    cars: Records
    """Shape (B, V)."""
    entry: Bytes
    """An `Entry` of each track of the simulation's log, shape (B, T)."""
    paths: Paths
    """Tracks of all logs and paths along lanes, in the order in which they were first used."""
