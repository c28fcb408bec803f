"""What each kind of vehicle can do on its way through a junction."""

from __future__ import annotations

import numpy as np

from smarts.dynamics import vehicle, vehicle_names
from smarts.dynamics.layout import GRAVITY
from smarts.roads.paces import Performance
from smarts.types.vehicles import VehicleKind


def performance() -> Performance:
    """Return the abilities of all kinds; kinds without a vehicle model have infinite ones."""
    known, kinds = vehicle_names(), len(VehicleKind)
    found = Performance(*(np.full(kinds, np.inf) for _ in Performance._fields))
    for kind in VehicleKind:
        if kind.name.lower() in known:
            one = vehicle(kind.name.lower())
            found.acceleration[kind] = one.drive.force / one.mass - one.tyre.rolling_resistance * GRAVITY
            found.power[kind] = one.drive.power / one.mass
            found.agility[kind] = one.steering.rate / one.wheelbase
    return found
