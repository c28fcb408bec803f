"""Departed vehicles that are too close to vehicles of other providers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from smarts.geometry.boxes import boxes_overlap
from smarts.geometry.frames import heading_from_compass
from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_rows import centre_of
from smarts.roads.lane_graph import HEIGHT_REACH
from smarts.types.vehicles import VehicleStates

SPAWN_MARGIN = (10.0, 1.0)
"""Margin around an entering vehicle that is cleared of traffic: in front and behind, on either side [m]."""


def find_blocking(
    library: SumoLibrary,
    states: VehicleStates,
    names: Sequence[str],
    entering: Sequence[int],
    others: Iterable[int],
) -> list[str]:
    """Return the departed vehicles that are too close to vehicles of other providers.

    Vehicles that enter now get a margin. SUMO keeps the others clear itself, but for the part of a vehicle
    that leans out of its lane.

    Args:
        library: The copy of libsumo that runs the simulation.
        states: Vehicles of the simulation.
        names: SUMO ids of the departed vehicles.
        entering: Slots of vehicles that enter now, which are kept clear with a margin.
        others: Slots of all vehicles of other providers.
    """
    entering = [slot for slot in entering if states.alive[slot]]
    others = [slot for slot in others if slot not in entering and states.alive[slot]]
    slots = [*entering, *others]
    if not names or not slots:
        return []
    vehicle = library.vehicle
    size = np.array([(vehicle.getLength(name), vehicle.getWidth(name)) for name in names])
    fronts = [*map(vehicle.getPosition, names)]
    if not entering and _are_far(fronts, size.tolist(), states, others):
        return []
    front = np.array(fronts)
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
    height = np.array([vehicle.getPosition3D(name)[2] for name in names])
    overlap &= ~(np.abs(height[:, None] - states.height[slots]) > HEIGHT_REACH)
    return [names[row] for row in np.flatnonzero(overlap.any(axis=1)).tolist()]


def _are_far(
    fronts: Sequence[tuple[float, ...]],
    sizes: Sequence[Sequence[float]],
    states: VehicleStates,
    others: Sequence[int],
) -> bool:
    """Return whether the vehicles with these fronts [m] and sizes [m] cannot overlap any of `others`.

    Most cannot: a few distances take a tenth of the time of the test of their boxes.
    """
    places, lengths = states.position[others].tolist(), states.length[others].tolist()
    widths = states.width[others].tolist()
    return all(
        # From the front to any corner it is at most length + width.
        math.dist(front[:2], place) > sum(size) + length + width
        for front, size in zip(fronts, sizes, strict=True)
        for place, length, width in zip(places, lengths, widths, strict=True)
    )
