"""What vehicles of each kind can do, for all kernels that choose by kind."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.dynamics import VehicleParameters, vehicle, vehicle_names
from smarts.dynamics.layout import GRAVITY
from smarts.roads.atlas import RoadAtlas
from smarts.roads.paces import Performance
from smarts.types.vehicles import VehicleKind

LOCK_SHARE = 0.95
"""Share of the steering lock that plans may use."""


class Abilities(NamedTuple):
    """Kinematic limits of each `VehicleKind`, shape (K,) each; infinite for kinds without a vehicle."""

    agility: Floats
    """Maximum rate of change of the curvature, from the steering rate [1/(m s)]."""
    wheelbase: Floats
    """Distance between the axles [m]."""
    centre_to_rear: Floats
    """Distance from the footprint's centre back to the rear axle [m]."""
    sharpest: Floats
    """Maximum curvature of the rear axle's path [1/m]."""

    @classmethod
    def of_all(cls) -> Abilities:
        """Return the limits of all kinds."""
        return cls(
            _by_kind(lambda car: car.steering.rate / car.wheelbase),
            _by_kind(lambda car: car.wheelbase, 1.0),
            _by_kind(lambda car: car.cog_to_rear_axle - car.centre_to_cog, 0.0),
            _by_kind(lambda car: math.tan(LOCK_SHARE * car.steering.max_angle) / car.wheelbase),
        )


def performance(atlas: RoadAtlas) -> Performance:
    """Return what vehicles of each kind can do on the lanes of an atlas; without parameters, anything."""
    agility = Abilities.of_all().agility
    return Performance(
        _by_kind(lambda car: car.drive.force / car.mass - car.tyre.rolling_resistance * GRAVITY),
        _by_kind(lambda car: car.drive.power / car.mass),
        agility,
        atlas.paces(agility),
    )


def _by_kind(number: Callable[[VehicleParameters], float], without: float = np.inf) -> Floats:
    """Return a number of each `VehicleKind`, `without` for kinds that have no vehicle."""
    names = [kind.name.lower() for kind in VehicleKind]
    return np.array([number(vehicle(name)) if name in vehicle_names() else without for name in names])
