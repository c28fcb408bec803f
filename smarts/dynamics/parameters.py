"""Parameters of vehicles and tyres: typed models of the YAML files beside this module."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator, Field

from smarts.config import Section, read_config

FOLDER = Path(__file__).parent
Texts = Annotated[tuple[str, ...], Field(strict=False)]
Three = Annotated[tuple[float, float, float], Field(strict=False)]


class LongitudinalCurve(Section):
    """The Magic Formula's longitudinal force; names as in Pacejka (2012), equations 4.E9-4.E18."""

    pcx1: float
    """Shape."""
    pdx1: float
    """Friction at nominal load."""
    pdx2: float
    """Variation of friction with load."""
    pex1: float
    """Curvature at nominal load."""
    pex2: float
    """Variation of curvature with load."""
    pex3: float
    """Variation of curvature with load squared."""
    pkx1: float
    """Slip stiffness over load at nominal load."""
    pkx2: float
    """Variation of slip stiffness with load."""
    pkx3: float
    """Exponent of slip stiffness with load."""


class LateralCurve(Section):
    """The Magic Formula's lateral force; names as in Pacejka (2012), equations 4.E19-4.E30."""

    pcy1: float
    """Shape."""
    pdy1: float
    """Friction at nominal load."""
    pdy2: float
    """Variation of friction with load."""
    pey1: float
    """Curvature at nominal load."""
    pey2: float
    """Variation of curvature with load."""
    pky1: float
    """Largest cornering stiffness over nominal load; negative by the formula's convention."""
    pky2: float
    """Load over nominal load at which cornering stiffness is largest."""
    pky4: float
    """Curvature of cornering stiffness over load."""


class TyreParameters(Section):
    """One tyre."""

    description: str
    source: Texts
    radius: float
    """Rolling radius [m]."""
    nominal_load: float
    """Load at which the coefficients hold [N]."""
    vertical_stiffness: float
    """[N/m]."""
    carcass_stiffness_x: float
    """Force over longitudinal deflection of the standing tyre [N/m]."""
    carcass_stiffness_y: float
    """Force over lateral deflection of the standing tyre [N/m]."""
    rolling_resistance: float
    """Resisting force over load."""
    longitudinal: LongitudinalCurve
    lateral: LateralCurve


class SteeringParameters(Section):
    """The steering of the front wheels."""

    max_angle: float
    """Lock of an imagined wheel between the front wheels [rad]."""
    rate: float
    """How fast that angle can change [rad/s]."""


class DriveParameters(Section):
    """The engine as the driven wheels feel it: a force limit at low speed, a power limit above."""

    force: float
    """[N]."""
    power: float
    """[W]."""


class AxleParameters(Section):
    """One axle; stiffnesses, torques and inertias are per side."""

    track: float
    """Distance between the wheels [m]."""
    spring: float
    """[N/m] at the wheel."""
    damper: float
    """[N s/m] at the wheel."""
    roll_stiffness: float
    """What the axle adds to the springs' roll stiffness [N m/rad].

    Positive for an anti-roll bar, negative where the springs stand closer together than the wheels.
    """
    tyres: int
    """1, or 2 for twin tyres."""
    wheel_inertia: float
    """Inertia about the wheel's axis [kg m^2]."""
    brake_torque: float
    """Torque with the pedal fully down [N m]."""
    drive_share: float
    """Share of the engine's force on this axle; the shares of both axles add up to 1."""


@functools.cache
def tyre(name: str) -> TyreParameters:
    """Return the parameters of a tyre."""
    return read_config(FOLDER / "tyres" / f"{name}.yaml", TyreParameters)


class VehicleParameters(Section):
    """One type of vehicle."""

    description: str
    source: Texts
    length: float
    """Length of the footprint [m]."""
    width: float
    """Width of the footprint [m]."""
    height: float
    """Height of the roof above the road [m]."""
    clearance: float
    """Height of the body's underside above the road [m]."""
    front_overhang: float
    """Distance from the front axle to the front bumper [m]."""
    mass: float
    """[kg]."""
    inertia: Three
    """Inertia about the centre of gravity: roll, pitch, yaw [kg m^2]."""
    cog_to_front_axle: float
    """[m]."""
    cog_to_rear_axle: float
    """[m]."""
    cog_height: float
    """Height of the centre of gravity above the road [m]."""
    drag_area: float
    """Drag coefficient times frontal area [m^2]."""
    tyre: Annotated[TyreParameters, BeforeValidator(tyre)]
    tyre_scale: float
    """The tyre's nominal load and stiffnesses are multiplied by this."""
    steering: SteeringParameters
    drive: DriveParameters
    front: AxleParameters
    rear: AxleParameters
    abs: bool
    traction_control: bool

    @property
    def wheelbase(self) -> float:
        """Distance between the axles [m]."""
        return self.cog_to_front_axle + self.cog_to_rear_axle

    @property
    def centre_to_cog(self) -> float:
        """How far the centre of gravity lies before the centre of the footprint [m]."""
        return 0.5 * self.length - self.front_overhang - self.cog_to_front_axle


ALIASES = {"sedan": "passenger"}
"""Other names of vehicle types."""


def vehicle_names() -> tuple[str, ...]:
    """Return the names that `vehicle` knows."""
    return tuple(sorted([*[file.stem for file in (FOLDER / "vehicles").glob("*.yaml")], *ALIASES]))


@functools.cache
def vehicle(name: str) -> VehicleParameters:
    """Return the parameters of a vehicle type."""
    return read_config(FOLDER / "vehicles" / f"{ALIASES.get(name, name)}.yaml", VehicleParameters)
