"""What each kind of vehicle can do on its way through a junction."""

from __future__ import annotations

import numpy as np

from smarts.dynamics import vehicle, vehicle_names
from smarts.dynamics.layout import GRAVITY
from smarts.roads.atlas import RoadAtlas
from smarts.roads.paces import Performance
from smarts.types.vehicles import VehicleKind


def performance(atlas: RoadAtlas) -> Performance:
    """Return the abilities of all kinds on an atlas's maps; kinds without a vehicle model have infinite ones.

    The lanes' paces are worked out once for each atlas.
    """
    known, kinds = vehicle_names(), len(VehicleKind)
    acceleration, power, agility = (np.full(kinds, np.inf) for _ in range(3))
    for kind in VehicleKind:
        if kind.name.lower() in known:
            one = vehicle(kind.name.lower())
            acceleration[kind] = one.drive.force / one.mass - one.tyre.rolling_resistance * GRAVITY
            power[kind] = one.drive.power / one.mass
            agility[kind] = one.steering.rate / one.wheelbase
    return Performance(acceleration, power, agility, atlas.paces(agility))
