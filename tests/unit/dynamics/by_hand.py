"""A vehicle as the books have it, in plain NumPy, from the numbers of its file alone."""

import math

import numpy as np
import pytest

from smarts.dynamics import vehicle
from smarts.dynamics.layout import AIR_DENSITY, GRAVITY
from smarts.dynamics.wheel import BREAKAWAY_SPEED

TYPES = ("passenger", "bus", "coach", "truck", "motorcycle")
EACH = [
    name if name in ("passenger", "bus") else pytest.param(name, marks=pytest.mark.nightly) for name in TYPES
]
"""The types as cases of a test: a car and a bus in `make test`, the others nightly."""
FRONT, REAR = 0, 2
"""The left wheel of each axle."""


class Car:
    """A vehicle's parameters from its file, by the names of the books."""

    def __init__(self, name):
        record = vehicle(name)
        self.record, self.tyre = record, record.tyre
        self.m, self.iz = record.mass, record.inertia[2]
        self.lf, self.lr, self.wheelbase = record.cog_to_front_axle, record.cog_to_rear_axle, record.wheelbase
        self.air = 0.5 * AIR_DENSITY * record.drag_area
        lever = {FRONT: self.lr, REAR: self.lf}
        self.axle = {FRONT: record.front, REAR: record.rear}
        self.static = {end: 0.5 * self.m * GRAVITY * lever[end] / self.wheelbase for end in lever}
        self.nominal = {
            end: self.tyre.nominal_load * record.tyre_scale * self.axle[end].tyres for end in lever
        }

    def loads(self, push):
        """Loads of one front and one rear wheel while the tyres push forward with `push` [N]."""
        moved = 0.5 * push * self.record.cog_height / self.wheelbase
        return {FRONT: self.static[FRONT] - moved, REAR: self.static[REAR] + moved}

    def grip(self, end, load, friction, curve):
        """Largest force of a wheel, the road's friction being that of the longitudinal one at static load."""
        x = self.tyre.longitudinal
        at_rest = x.pdx1 + x.pdx2 * (self.static[end] / self.nominal[end] - 1.0)
        first, second = (x.pdx1, x.pdx2) if curve == "x" else (self.tyre.lateral.pdy1, self.tyre.lateral.pdy2)
        return friction / at_rest * (first + second * (load / self.nominal[end] - 1.0)) * load

    def cornering_stiffness(self, end, load):
        y = self.tyre.lateral
        return -y.pky1 * self.nominal[end] * math.sin(y.pky4 * math.atan(load / (y.pky2 * self.nominal[end])))

    def side_force(self, end, load, friction, slip, tyres):
        """One wheel's force to the left at a slip (tangent of the slip angle)."""
        if tyres == "linear":
            return np.clip(
                self.cornering_stiffness(end, self.static[end]) * slip, *(friction * load * np.array([-1, 1]))
            )
        y, largest = self.tyre.lateral, self.grip(end, load, friction, "y")
        c, e = y.pcy1, min(y.pey1 + y.pey2 * min(load / self.nominal[end] - 1.0, 1.0), 1.0)
        x = self.cornering_stiffness(end, load) / (c * largest) * slip
        return largest * math.sin(c * math.atan(x - e * (x - math.atan(x))))

    def is_stretched(self, end, load, friction, slip, sliding):
        """Whether the model's bristle is as long as it gets: far beyond the peak, at low sliding speeds.

        There the model leaves the steady Magic Formula on purpose, see `smarts.dynamics.wheel`.
        """
        largest, stiffness = self.grip(end, load, friction, "y"), self.cornering_stiffness(end, load)
        return abs(stiffness * slip / largest) > 1.0 + abs(sliding) / BREAKAWAY_SPEED

    def sliding_share(self, end, load, friction):
        """Force of a wheel that is locked at speed, over its largest."""
        x, excess = self.tyre.longitudinal, load / self.nominal[end] - 1.0
        stiffness = load * (x.pkx1 + x.pkx2 * excess) * math.exp(x.pkx3 * excess)
        e = x.pex1 + x.pex2 * excess + x.pex3 * excess**2
        slope = stiffness / (x.pcx1 * self.grip(end, load, friction, "x"))
        return math.sin(x.pcx1 * math.atan(slope - e * (slope - math.atan(slope))))

    def straight_braking(self, speed, friction, *, locked=False):
        """Deceleration [m/s^2] and load of a wheel of each axle, all at their largest force or locked.

        The load that braking moves follows the tyres' force at once.
        """
        drag, tyres = self.air * speed**2, friction * self.m * GRAVITY
        for _ in range(30):
            load = self.loads(-tyres)
            tyres = 2.0 * sum(
                self.grip(end, at, friction, "x") * (self.sliding_share(end, at, friction) if locked else 1.0)
                for end, at in load.items()
            )
        return (tyres + drag) / self.m, load

    def stopping_distance(self, speed, friction, *, locked=False):
        """The integral of v dv / a [m]."""
        speeds = (np.arange(200) + 0.5) * speed / 200
        rates = [self.straight_braking(each, friction, locked=locked)[0] for each in speeds]
        return float((speeds / rates).sum() * speed / 200)

    def largest_x(self, end, load, friction, tyres):
        return friction * load if tyres == "linear" else self.grip(end, load, friction, "x")

    def forces_along(self, end, throttle, brake, load, speed):
        """Drive and resisting force of an axle."""
        drive = self.record.drive
        push = throttle * min(drive.force, drive.power / max(abs(speed), 1e-9)) * self.axle[end].drive_share
        rolling = 2.0 * self.tyre.rolling_resistance * load
        return push, 2.0 * brake * self.axle[end].brake_torque / self.tyre.radius + rolling
