"""Inputs and outputs of a fleet: arrays with one row per vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from smarts.arrays import Bools, Floats, Longs


@dataclass(frozen=True)
class Road:
    """The road under each vehicle. Written by the caller; kept until overwritten."""

    friction: Floats
    """Largest longitudinal force over load at each wheel, shape (E, 4)."""
    normal: Floats
    """Unit normal of the plane that the vehicle drives on, shape (E, 3). Only model "bullet"
    supports slopes."""
    offset: Floats
    """Distance of that plane from the origin along the normal [m], shape (E,)."""


class Motion(NamedTuple):
    """How the vehicles move; row *i* of every array is vehicle *i*.

    The arrays are read-only and overwritten by the next step.
    """

    active: Bools
    """Whether the row holds a vehicle; the other values of a row without are meaningless. Shape (E,)."""
    substeps: Floats
    """x, y of the footprint's centre [m] and heading [rad] after each sub-step, shape (E, S, 3)."""
    position: Floats
    """Centre of the footprint [m], shape (E, 2)."""
    heading: Floats
    """[rad], shape (E,)."""
    velocity: Floats
    """Velocity of the centre of gravity, forward and left [m/s], shape (E, 2)."""
    yaw_rate: Floats
    """[rad/s], shape (E,)."""
    acceleration: Floats
    """Mean acceleration of the centre of gravity over the step, forward and left [m/s^2], shape (E, 2)."""
    steering: Floats
    """Angle of an imagined wheel between the front wheels, positive to the left [rad], shape (E,)."""
    overhang: Floats
    """How far the body may reach beyond the footprint while it is not upright [m], shape (E,)."""


@dataclass(frozen=True)
class Wheels:
    """The wheels after the last sub-step, shape (E, 4): front left, front right, rear left, rear right."""

    position: Floats
    """Places of the wheels on the map [m], shape (E, 4, 2): the road's friction is looked up there."""
    spin: Floats
    """[rad/s]."""
    slip: Floats
    """Longitudinal slip at the contact, positive when driving. Zero for single-track vehicles."""
    slip_angle: Floats
    """[rad], positive when the tyre pushes to the left."""
    load: Floats
    """[N]."""
    force_x: Floats
    """Force of the tyre along its heading [N]."""
    force_y: Floats
    """Force of the tyre to its left [N]."""


class SubstepDriver(Protocol):
    """Changes the controls within a step."""

    def __call__(self, rows: Longs, /) -> None:
        """Write the controls of `rows`, the vehicles that move, for the next sub-step; shape (R,)."""
        ...
