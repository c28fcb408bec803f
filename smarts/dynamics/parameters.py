"""What a vehicle and a tyre are made of: typed records read from the YAML files beside this module."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from importlib import resources
from typing import Any, TypeVar, get_type_hints

import yaml

from smarts.errors import SmartsError, UnknownNameError, nearest_names


class VehicleParametersError(SmartsError):
    """A vehicle or tyre file holds something else than numbers for the known fields."""


@dataclass(frozen=True)
class LongitudinalCurve:
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


@dataclass(frozen=True)
class LateralCurve:
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


@dataclass(frozen=True)
class TyreParameters:
    """One tyre."""

    description: str
    source: tuple[str, ...]
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


@dataclass(frozen=True)
class SteeringParameters:
    """The steering of the front wheels."""

    max_angle: float
    """Lock of an imagined wheel between the front wheels [rad]."""
    rate: float
    """How fast that angle can change [rad/s]."""


@dataclass(frozen=True)
class DriveParameters:
    """The engine as the driven wheels feel it: a force limit at low speed, a power limit above."""

    force: float
    """[N]."""
    power: float
    """[W]."""


@dataclass(frozen=True)
class AxleParameters:
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
    """About the wheel's axis [kg m^2]."""
    brake_torque: float
    """With the pedal fully down [N m]."""
    drive_share: float
    """Of the engine's force; the shares of both axles add up to 1."""


@dataclass(frozen=True)
class VehicleParameters:
    """One type of vehicle."""

    description: str
    source: tuple[str, ...]
    length: float
    """Of the footprint [m]."""
    width: float
    """Of the footprint [m]."""
    height: float
    """Of the roof above the road [m]."""
    clearance: float
    """Of the body above the road [m]."""
    front_overhang: float
    """Of the front bumper before the front axle [m]."""
    mass: float
    """[kg]."""
    inertia: tuple[float, ...]
    """About the centre of gravity, roll, pitch, yaw [kg m^2]."""
    cog_to_front_axle: float
    """[m]."""
    cog_to_rear_axle: float
    """[m]."""
    cog_height: float
    """Of the centre of gravity above the road [m]."""
    drag_area: float
    """Drag coefficient times frontal area [m^2]."""
    tyre: TyreParameters
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
    return tuple(sorted([*_stems("vehicles"), *ALIASES]))


@functools.cache
def vehicle(name: str) -> VehicleParameters:
    """Return the parameters of a vehicle type.

    Raises:
        UnknownNameError: There is no such type, or it cannot drive (a trailer).
        VehicleParametersError: Its file is broken.
    """
    if name not in vehicle_names():
        raise UnknownNameError(
            f"no vehicle {name!r} can be driven", remedy=nearest_names(name, vehicle_names())
        )
    return _read(VehicleParameters, "vehicles", ALIASES.get(name, name))


@functools.cache
def tyre(name: str) -> TyreParameters:
    """Return the parameters of a tyre.

    Raises:
        UnknownNameError: There is no such tyre.
        VehicleParametersError: Its file is broken.
    """
    if name not in _stems("tyres"):
        raise UnknownNameError(f"no tyre {name!r}", remedy=nearest_names(name, _stems("tyres")))
    return _read(TyreParameters, "tyres", name)


def _stems(folder: str) -> list[str]:
    files = resources.files("smarts.dynamics").joinpath(folder).iterdir()
    return [file.name.removesuffix(".yaml") for file in files if file.name.endswith(".yaml")]


Record = TypeVar("Record")


def _read(kind: type[Record], folder: str, name: str) -> Record:
    file = resources.files("smarts.dynamics").joinpath(folder).joinpath(f"{name}.yaml")
    return parse(kind, yaml.safe_load(file.read_text()), f"{folder}/{name}.yaml")


def parse(kind: type[Record], values: Any, place: str) -> Record:
    """Return a record of the given dataclass from what YAML read.

    Args:
        kind: A dataclass of this module.
        values: A mapping that has every field and no other.
        place: File, and path in it, for the error.

    Raises:
        VehicleParametersError: A field is unknown, missing, or of another type than declared.
    """
    hints = get_type_hints(kind)
    fields = [field.name for field in dataclasses.fields(kind)]  # type: ignore[arg-type]
    if not isinstance(values, dict):
        raise VehicleParametersError(
            f"{values!r} is not a mapping", place=place, remedy=f"give {', '.join(fields)}"
        )
    for key in values:
        if key not in fields:
            raise VehicleParametersError(
                f"unknown field {key!r}", place=place, remedy=nearest_names(str(key), fields)
            )
    for field in fields:
        if field not in values:
            raise VehicleParametersError(f"field {field!r} is missing", place=place, remedy="add it")
    return kind(**{field: _convert(hints[field], values[field], f"{place}: {field}") for field in fields})


def _convert(kind: Any, value: Any, place: str) -> Any:
    if kind is TyreParameters:
        return tyre(value)
    if dataclasses.is_dataclass(kind):
        return parse(kind, value, place)  # type: ignore[arg-type]
    try:
        if kind is float:
            # PyYAML reads 5e-4 as a string, so the declared type decides.
            return float(value)
        if kind == tuple[float, ...]:
            return tuple(float(item) for item in value)
    except (TypeError, ValueError) as error:
        raise VehicleParametersError(
            f"{value!r} is not a number", place=place, remedy="give a number"
        ) from error
    if kind == tuple[str, ...]:
        return tuple(str(item) for item in value)
    if not isinstance(value, kind):
        raise VehicleParametersError(
            f"{value!r} is not of type {kind.__name__}", place=place, remedy="mend the file"
        )
    return value
