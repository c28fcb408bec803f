"""Checks of a fleet's arguments and motion."""

from __future__ import annotations

import math

from smarts.arrays import Floats
from smarts.dynamics import layout
from smarts.errors import SmartsError, UnknownNameError, nearest_names


class ControlError(SmartsError):
    """Invalid controls, or a row that cannot hold the vehicle."""


class MotionError(SmartsError):
    """A vehicle's motion is not finite."""


def check_models(row: int, model: str, tyres: str) -> None:
    """Raise if `model` or `tyres` is unknown.

    Raises:
        UnknownNameError: It is none of `layout.MODELS`, or none of `layout.TYRE_MODELS`.
    """
    for kind, given, known in (("model", model, layout.MODELS), ("tyre model", tyres, layout.TYRE_MODELS)):
        if given not in known:
            remedy = nearest_names(given, known)
            raise UnknownNameError(f"no {kind} {given!r}", place=_vehicle(row), remedy=remedy)


def check_start(
    row: int,
    position: tuple[float, float],
    heading: float,
    speed: float,
    steering: float,
    size: tuple[float, float] | None,
) -> None:
    """Raise if a number is not finite or a size is not positive.

    Raises:
        ControlError: A number is not finite, or a size not above 0.
    """
    if size is not None and not all(math.isfinite(each) and each > 0.0 for each in size):
        raise ControlError(
            f"a body of {size[0]} m by {size[1]} m", place=_vehicle(row), remedy="give sizes above 0"
        )
    if not all(map(math.isfinite, (*position, heading, speed, steering))):
        raise ControlError(
            f"position {position}, heading {heading}, speed {speed}, steering {steering}: not all finite",
            place=_vehicle(row),
            remedy="give finite numbers",
        )


def check_wheel(row: int, wheel: int) -> None:
    """Raise if `wheel` is not 0 to 3.

    Raises:
        ControlError: It has no such wheel.
    """
    if not 0 <= wheel < layout.WHEELS:
        raise ControlError(f"there is no wheel {wheel}", place=_vehicle(row), remedy="wheels are 0 to 3")


def check_shape(controls: Floats, shape: tuple[int, ...]) -> None:
    """Raise unless `controls` has `shape`.

    Raises:
        ControlError: They have another shape.
    """
    if controls.shape != shape:
        raise ControlError(f"controls have shape {controls.shape}", remedy=f"send shape {shape}")


def not_numbers(row: int, controls: Floats) -> ControlError:
    """Return the error of a row whose controls, shape (3,), hold NaN."""
    return ControlError(
        f"controls {controls.tolist()} (throttle, brake, steering) are not numbers",
        place=_vehicle(row),
        remedy="send finite controls",
    )


def not_finite(row: int, body: Floats, road: Floats) -> MotionError:
    """Return the error of a row whose motion is not finite.

    Args:
        row: Of the vehicle.
        body: Its spatial motion, see `layout.BODY_SIZE`.
        road: Below it: friction, normal, offset [m].
    """
    return MotionError(
        f"motion is no longer finite: body {body.tolist()}, road (friction, normal, offset) {road.tolist()}",
        place=_vehicle(row),
        remedy="give the road finite numbers, and clear the simulation",
    )


def _vehicle(row: int) -> str:
    return f"vehicle in row {row}"
