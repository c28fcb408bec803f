"""Kinematic limits of each kind of vehicle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.controllers.model_predictive import sharpest_curvatures
from smarts.dynamics import vehicle, vehicle_names
from smarts.types.vehicles import VehicleKind


class Abilities(NamedTuple):
    """Kinematic limits of each `VehicleKind`, shape (K,) each."""

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
        """Return the limits of all kinds; kinds without a vehicle model have infinite limits."""
        known, kinds = vehicle_names(), len(VehicleKind)
        agility, wheelbase, centre_to_rear = np.full(kinds, np.inf), np.ones(kinds), np.zeros(kinds)
        for kind in VehicleKind:
            if kind.name.lower() in known:
                one = vehicle(kind.name.lower())
                agility[kind] = one.steering.rate / one.wheelbase
                wheelbase[kind] = one.wheelbase
                centre_to_rear[kind] = one.cog_to_rear_axle - one.centre_to_cog
        return cls(agility, wheelbase, centre_to_rear, sharpest_curvatures())
