"""The signal at the end of a lane; signals belong to the lanes inside junctions."""

from __future__ import annotations

from smarts.arrays import Bytes
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import RouteTable
from smarts.types.traffic import Signal

_NONE = int(Signal.NONE)


@kernel
def light_ahead(table: RouteTable, here: int, base: int, free: int, signals: Bytes) -> int:
    """Return the light at the end of a lane, a `Signal`.

    It is that of the lanes that this one leads into along the route; where it leads off the route, of all
    that it leads into. Where they show different lights, it is the one with which most may go.

    Args:
        table: The routes.
        here: Row of the lane in its corridor.
        base: First lane of the map.
        free: First row of the map's corridor without a route.
        signals: What is shown at the begin of each lane of the map, shape (L,).
    """
    if table.onward_start[here] == table.onward_start[here + 1]:
        here = free + table.lane[here] - base
    light = _NONE
    for entry in range(table.onward_start[here], table.onward_start[here + 1]):
        light = max(light, int(signals[table.lane[table.onward[entry]] - base]))
    return light
