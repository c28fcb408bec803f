"""Departed vehicles that are too close to vehicles of other providers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smarts.geometry.boxes import boxes_overlap
from smarts.geometry.frames import heading_from_compass
from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_rows import centre_of
from smarts.types.vehicles import VehicleStates

SPAWN_MARGIN = (10.0, 1.0)
"""Margin around an entering vehicle that is cleared of traffic: in front and behind, on either side [m]."""


def find_blocking(
    library: SumoLibrary,
    states: VehicleStates,
    names: Sequence[str],
    entering: Sequence[int],
    others: Sequence[int],
) -> list[str]:
    """Return the departed vehicles that overlap vehicles of other providers.

    Args:
        library: The copy of libsumo that runs the simulation.
        states: Vehicles of the simulation.
        names: SUMO ids of the departed vehicles.
        entering: Slots of vehicles that enter now, which are kept clear with a margin.
        others: Slots of other providers' other vehicles.
    """
    slots = [*entering, *others]
    if not names or not slots:
        return []
    vehicle = library.vehicle
    size = np.array([(vehicle.getLength(name), vehicle.getWidth(name)) for name in names])
    front = np.array([*map(vehicle.getPosition, names)])
    heading = heading_from_compass(np.array([*map(vehicle.getAngle, names)]))
    position = centre_of(front, heading, size[:, 0])
    kept = np.stack([states.length[slots], states.width[slots]], -1)
    kept[: len(entering)] += 2 * np.array(SPAWN_MARGIN)
    overlap = boxes_overlap(
        position[:, None],
        heading[:, None],
        size[:, None],
        states.position[slots],
        states.heading[slots],
        kept,
    )
    return [names[row] for row in np.flatnonzero(overlap.any(axis=1)).tolist()]
