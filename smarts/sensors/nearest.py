"""The nearest of many: one search for sensors, features and rewards."""

from __future__ import annotations

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.roads.levels import meets
from smarts.types.vehicles import VehicleStates


@kernel
def keep_nearest(found: Ints, far: Floats, count: int, item: int, distance: float) -> int:
    """Insert an item into a list ordered by distance, whose farthest may drop out; return the new count.

    Of items equally far the one that was inserted first comes first.

    Args:
        found: The items, as many as there is room for; written.
        far: Their distances, or squares of them; written.
        count: How many there are.
        item: To insert.
        distance: Of it.
    """
    if count == len(found) and distance >= far[count - 1]:
        return count
    place = min(count, len(found) - 1)
    while place > 0 and far[place - 1] > distance:
        found[place], far[place] = found[place - 1], far[place - 1]
        place -= 1
    found[place], far[place] = item, distance
    return min(count + 1, len(found))


@kernel
def nearest_vehicles(
    vehicles: VehicleStates, b: int, own: int, radius: float, found: Ints, squares: Floats
) -> int:
    """List the vehicles of simulation `b` nearest to the one in slot `own`, nearest first; return how many.

    Args:
        vehicles: All vehicles.
        b: The simulation.
        own: The slot in the middle.
        radius: Within which vehicles are listed, itself included [m].
        found: Their slots, as many as there is room for; written.
        squares: The squares of their distances [m^2]; written.
    """
    count = 0
    x, y = vehicles.position[b, own, 0], vehicles.position[b, own, 1]
    for slot in range(vehicles.alive.shape[1]):
        if not meets(vehicles, b, own, slot):
            continue
        dx, dy = vehicles.position[b, slot, 0] - x, vehicles.position[b, slot, 1] - y
        square = dx * dx + dy * dy
        # False for NaN, too.
        if square <= radius * radius:
            count = keep_nearest(found, squares, count, slot, square)
    return count
