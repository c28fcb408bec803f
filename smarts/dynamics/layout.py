"""Memory layout of a fleet: parameters and state as one record per vehicle, packed for the kernels.

Wheels are numbered front left, front right, rear left, rear right. Lengths are in the body's frame, x
forward, y left, z up, from the centre of gravity.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.dynamics import parameters
from smarts.dynamics.parameters import (
    AxleParameters,
    LateralCurve,
    LongitudinalCurve,
    TyreParameters,
    VehicleParameters,
)

WHEELS = 4
GRAVITY = 9.81
AIR_DENSITY = 1.2

MODELS = ("bullet", "dynamic", "kinematic")
"""A car in Bullet on four wheels; a planar single track with tyre forces; one that goes where it is
steered."""
TYRE_MODELS = ("linear", "pacejka")
"""Names of the tyre models; their order is the number in `PARAMETERS.tyre_model`."""

_F = np.float64
_PER_WHEEL = (WHEELS,)

PARAMETERS = np.dtype(
    [
        ("mass", _F),
        ("inertia", _F, (3,)),
        ("cog_height", _F),
        ("cog_to_front_axle", _F),
        ("cog_to_rear_axle", _F),
        ("centre_to_cog", _F),
        ("half_size", _F, (3,)),  # of the body's box [m]
        ("box_height", _F),  # of the box's centre above the centre of gravity [m]
        ("drag", _F),  # force over speed squared [N s^2/m^2]
        ("drive_force", _F),
        ("drive_power", _F),
        ("max_steering", _F),
        ("steering_rate", _F),
        ("abs", np.bool_),
        ("traction_control", np.bool_),
        # Per wheel
        ("wheel_x", _F, _PER_WHEEL),
        ("wheel_y", _F, _PER_WHEEL),
        ("spring", _F, _PER_WHEEL),  # of suspension and tyre in series [N/m]
        ("damper", _F, _PER_WHEEL),
        ("roll_spring", _F, _PER_WHEEL),  # load over the difference of both sides' compressions [N/m]
        ("static_load", _F, _PER_WHEEL),
        ("radius", _F, _PER_WHEEL),
        ("wheel_inertia", _F, _PER_WHEEL),
        ("brake_torque", _F, _PER_WHEEL),
        ("drive_share", _F, _PER_WHEEL),
        # The tyre (of both twins together, where there are twins)
        ("tyre_model", np.int64),
        ("nominal_load", _F, _PER_WHEEL),
        ("carcass_x", _F, _PER_WHEEL),
        ("carcass_y", _F, _PER_WHEEL),
        ("linear_x", _F, _PER_WHEEL),  # slip stiffness at the static load [N]
        ("linear_y", _F, _PER_WHEEL),
        ("static_grip", _F, _PER_WHEEL),  # the set's own longitudinal friction at the static load
        ("rolling_resistance", _F),
        ("peak_slip", _F),  # normalised slip of the largest longitudinal force
        *((name, _F) for curve in (LongitudinalCurve, LateralCurve) for name in curve.model_fields),
    ],
    align=True,
)
"""One vehicle's constants."""

STATE = np.dtype(
    [
        ("steering", _F),  # angle of an imagined wheel between the front wheels [rad]
        ("spin", _F, _PER_WHEEL),  # [rad/s]
        ("deflection_x", _F, _PER_WHEEL),  # of the tyre's contact, the bristle [m]
        ("deflection_y", _F, _PER_WHEEL),
        (
            "share_x",
            _F,
            _PER_WHEEL,
        ),  # force over what the unsaturated bristle would give, of the last sub-step
        # Read-out of the last sub-step
        ("load", _F, _PER_WHEEL),
        ("slip", _F, _PER_WHEEL),
        ("slip_angle", _F, _PER_WHEEL),
        ("force_x", _F, _PER_WHEEL),
        ("force_y", _F, _PER_WHEEL),
        # Faults: factors on a sound tyre's values, and a rolling resistance that comes on top
        ("radius_factor", _F, _PER_WHEEL),
        ("stiffness_factor", _F, _PER_WHEEL),
        ("grip_factor", _F, _PER_WHEEL),
        ("extra_resistance", _F, _PER_WHEEL),
    ],
    align=True,
)
"""What a vehicle carries from one sub-step to the next, besides its body's motion."""

BODY_SIZE = 13
"""A body's row: position of the centre of gravity (3), quaternion x y z w (4), velocity (3), angular velocity
(3)."""


Records = Any
"""A structured array: compiled code reads fields of its rows as attributes, which NumPy's type lacks."""


class FleetArrays(NamedTuple):
    """The arrays of a fleet of E vehicles that its kernels read and write; row *i* is vehicle *i*."""

    cars: Records
    """Parameters, shape (E,), dtype `PARAMETERS`."""
    states: Records
    """Shape (E,), dtype `STATE`."""
    bodies: Floats
    """Shape (E, 13), see `BODY_SIZE`."""
    before: Floats
    """Velocity in the world at the step's beginning [m/s], shape (E, 2)."""
    velocities: Floats
    """Linear [m/s] and angular velocity [rad/s] after the forces of a sub-step, shape (E, 2, 3)."""
    controls: Floats
    """Throttle, brake, steering, shape (E, 3)."""
    road: Floats
    """Friction at each wheel, normal of the road's plane, its distance from the origin [m], shape (E, 8)."""
    poses: Floats
    """Centre of the footprint [m] and heading [rad] after each sub-step, shape (E, S, 3)."""
    wheel_position: Floats
    """Places of the wheels on the map [m], shape (E, 4, 2)."""
    active: Bools
    """Whether the row holds a vehicle, shape (E,)."""
    lost: Bools
    """Whether the motion left the finite numbers in the last step, shape (E,)."""
    step: float
    """[s]"""
    dt: float
    """Sub-step [s]."""


@functools.cache
def pack(name: str, tyre_model: str) -> NDArray[np.void]:
    """Return a vehicle type's record of dtype `PARAMETERS`, shape ().

    Args:
        name: One of `parameters.vehicle_names`.
        tyre_model: One of `TYRE_MODELS`.
    """
    vehicle = parameters.vehicle(name)
    record = np.zeros((), PARAMETERS)
    _pack_body(record, vehicle)
    _pack_axle(record, vehicle, vehicle.front, slice(0, 2), front=True)
    _pack_axle(record, vehicle, vehicle.rear, slice(2, 4), front=False)
    _pack_tyre(record, vehicle.tyre, tyre_model)
    record.flags.writeable = False
    return record


def _pack_body(record: NDArray[np.void], vehicle: VehicleParameters) -> None:
    same = ("mass", "inertia", "cog_height", "cog_to_front_axle", "cog_to_rear_axle", "centre_to_cog")
    for name in (*same, "abs", "traction_control"):
        record[name] = getattr(vehicle, name)
    record["half_size"] = (
        0.5 * vehicle.length,
        0.5 * vehicle.width,
        0.5 * (vehicle.height - vehicle.clearance),
    )
    record["box_height"] = 0.5 * (vehicle.height + vehicle.clearance) - vehicle.cog_height
    record["drag"] = 0.5 * AIR_DENSITY * vehicle.drag_area
    record["drive_force"] = vehicle.drive.force
    record["drive_power"] = vehicle.drive.power
    record["max_steering"] = vehicle.steering.max_angle
    record["steering_rate"] = vehicle.steering.rate


def _pack_axle(
    record: NDArray[np.void], vehicle: VehicleParameters, axle: AxleParameters, wheels: slice, *, front: bool
) -> None:
    tyre, scale = vehicle.tyre, vehicle.tyre_scale * axle.tyres
    lever = vehicle.cog_to_rear_axle if front else vehicle.cog_to_front_axle
    load = 0.5 * vehicle.mass * GRAVITY * lever / vehicle.wheelbase
    record["wheel_x"][wheels] = vehicle.cog_to_front_axle if front else -vehicle.cog_to_rear_axle
    record["wheel_y"][wheels] = 0.5 * axle.track, -0.5 * axle.track
    record["spring"][wheels] = 1.0 / (1.0 / axle.spring + 1.0 / (tyre.vertical_stiffness * scale))
    record["damper"][wheels] = axle.damper
    record["roll_spring"][wheels] = _roll_spring(axle, tyre.vertical_stiffness * scale)
    record["static_load"][wheels] = load
    record["radius"][wheels] = tyre.radius
    record["wheel_inertia"][wheels] = axle.wheel_inertia
    record["brake_torque"][wheels] = axle.brake_torque
    record["drive_share"][wheels] = 0.5 * axle.drive_share
    record["nominal_load"][wheels] = tyre.nominal_load * scale
    record["carcass_x"][wheels] = tyre.carcass_stiffness_x * scale
    record["carcass_y"][wheels] = tyre.carcass_stiffness_y * scale
    grip, stiffness_x, stiffness_y = _at_load(tyre, load, tyre.nominal_load * scale)
    record["static_grip"][wheels] = grip
    record["linear_x"][wheels] = stiffness_x
    record["linear_y"][wheels] = stiffness_y


def _roll_spring(axle: AxleParameters, tyre_stiffness: float) -> float:
    """Return load over the difference of both sides' compressions that the springs alone do not give [N/m].

    A roll angle phi makes a difference of track * phi, and both sides' loads act at half a track.
    """
    lever = 0.5 * axle.track**2
    suspension, tyre = axle.spring * lever + axle.roll_stiffness, tyre_stiffness * lever
    both = 1.0 / (1.0 / suspension + 1.0 / tyre)
    return (both - lever / (1.0 / axle.spring + 1.0 / tyre_stiffness)) / axle.track**2


def _at_load(tyre: TyreParameters, load: float, nominal: float) -> tuple[float, float, float]:
    """Return longitudinal friction and both slip stiffnesses [N] of the set itself at a load [N]."""
    excess = load / nominal - 1.0
    x, y = tyre.longitudinal, tyre.lateral
    grip = x.pdx1 + x.pdx2 * excess
    stiffness_x = load * (x.pkx1 + x.pkx2 * excess) * math.exp(x.pkx3 * excess)
    stiffness_y = -y.pky1 * nominal * math.sin(y.pky4 * math.atan(load / (y.pky2 * nominal)))
    return grip, stiffness_x, stiffness_y


def _pack_tyre(record: NDArray[np.void], tyre: TyreParameters, model: str) -> None:
    record["tyre_model"] = TYRE_MODELS.index(model)
    record["rolling_resistance"] = tyre.rolling_resistance
    for curve in (tyre.longitudinal, tyre.lateral):
        for name, value in vars(curve).items():
            record[name] = value
    shape, curvature = tyre.longitudinal.pcx1, tyre.longitudinal.pex1
    record["peak_slip"] = 1.0 if model == "linear" else peak_slip(shape, curvature)


def peak_slip(shape: float, curvature: float) -> float:
    """Return the normalised slip at which sin(C atan(B xi - E (B xi - atan(B xi)))), B = 1/C, is largest."""
    # The inner expression grows with its argument for E < 1, so bisection finds where it is tan(pi / 2C).
    target, low, high = math.tan(0.5 * math.pi / shape), 0.0, 1000.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        inner = middle - curvature * (middle - math.atan(middle))
        low, high = (middle, high) if inner < target else (low, middle)
    return shape * high


def fresh_state(car: NDArray[np.void], speed: float, steering: float) -> NDArray[np.void]:
    """Return the state of a vehicle with sound tyres that rolls at `speed` [m/s], shape ()."""
    state = np.zeros((), STATE)
    for factor in ("radius_factor", "stiffness_factor", "grip_factor", "share_x"):
        state[factor] = 1.0
    state["steering"] = steering
    state["spin"] = speed / car["radius"]
    state["load"] = car["static_load"]
    return state


def settled_body(
    car: NDArray[np.void],
    position: tuple[float, float],
    heading: float,
    speed: float,
    yaw_rate: float,
    plane: Floats,
) -> Floats:
    """Return the row of a body that rolls on a plane, its suspension settled, its rear axle not sliding.

    Args:
        car: Record of `PARAMETERS`.
        position: Centre of the footprint [m].
        heading: [rad].
        speed: Forward [m/s].
        yaw_rate: [rad/s].
        plane: Unit normal and distance from the origin [m], shape (4,).
    """
    up, offset = plane[:3], plane[3]
    ux, uy, uz = up.tolist()
    fx, fy = math.cos(heading), math.sin(heading)
    fz = -(ux * fx + uy * fy) / uz
    forward = np.array([fx, fy, fz]) / math.sqrt(fx * fx + fy * fy + fz * fz)
    fx, fy, fz = forward.tolist()
    left = np.array([uy * fz - uz * fy, uz * fx - ux * fz, ux * fy - uy * fx])
    x, y = position
    ground = np.array([x, y, (offset - ux * x - uy * y) / uz])
    body = np.zeros(BODY_SIZE)
    body[0:3] = ground + car["centre_to_cog"] * forward + car["cog_height"] * up
    body[3:7] = _quaternion(forward, left, up)
    body[7:10] = speed * forward + yaw_rate * car["cog_to_rear_axle"] * left
    body[10:13] = yaw_rate * up
    return body


def _quaternion(forward: Floats, left: Floats, up: Floats) -> Floats:
    """Return the quaternion x y z w of the rotation with these axes, upright enough to be driven."""
    (fx, fy, fz), (lx, ly, lz), (ux, uy, uz) = forward.tolist(), left.tolist(), up.tolist()
    w = 0.5 * math.sqrt(max(1.0 + fx + ly + uz, 0.0))
    if w > 1e-3:
        return np.array([(lz - uy) / (4 * w), (ux - fz) / (4 * w), (fy - lx) / (4 * w), w])
    # Nearly half a turn: w is lost in rounding, z is not. Due west is exact.
    z = 0.5 * math.sqrt(1.0 - fx - ly + uz)
    found = np.array([(fz + ux) / (4 * z), (lz + uy) / (4 * z), z, (fy - lx) / (4 * z)])
    return np.where(np.abs(found) < 1e-12, 0.0, found)
