"""How high vehicles are: the only thing about them that is not in the world's state."""

from __future__ import annotations

import numpy as np

from smarts.geometry.compiling import kernel

HEIGHTS = np.array([1.5, 3.0, 3.5, 3.5, 3.5, 1.5, 1.7, 1.719])
"""Height of each `VehicleKind` [m]: car, bus, coach, truck, trailer, motorcycle and bicycle with rider,
pedestrian."""


@kernel
def vehicle_height(kind: int) -> float:
    """Return the height of a vehicle [m]."""
    return HEIGHTS[kind]
