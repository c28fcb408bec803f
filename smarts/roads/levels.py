"""Levels: what is on a bridge, and what is below it, do not meet."""

from __future__ import annotations

from smarts.geometry.compiling import kernel
from smarts.roads.kernels import is_level
from smarts.types.vehicles import VehicleStates


@kernel
def meets(vehicles: VehicleStates, b: int, own: int, other: int) -> bool:
    """Return whether a slot of simulation `b` holds another vehicle than `own`, at a height near its own."""
    if other == own or not vehicles.alive[b, other]:
        return False
    return is_level(vehicles.height[b, own], vehicles.height[b, other])
