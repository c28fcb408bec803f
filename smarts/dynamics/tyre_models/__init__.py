"""Tyre models, by name: each says how stiff and how strong a tyre is, and how force grows with slip.

A model is one file with two kernels: `characteristics` (largest forces, slip stiffnesses, curvatures at a
load and friction) and `curve` (force over largest force at a normalised slip). Normalised slip is the force
that the bristle would carry if it did not slide, over the largest force. Longitudinal and lateral slip
combine by similarity (Pacejka 2012, section 4.3.1): both curves are taken at the length of the vector of
normalised slips, and the force points along it, so that the force never leaves the friction ellipse and
opposes the sliding of a locked wheel.

To add a model: its file, its name in `layout.TYRE_MODELS`, and its line in each of the kernels below.
"""

from __future__ import annotations

import math

from smarts.dynamics.layout import TYRE_MODELS
from smarts.dynamics.tyre_models import linear, pacejka
from smarts.geometry.compiling import kernel

LINEAR = TYRE_MODELS.index("linear")


@kernel
def characteristics(car, wheel, load, friction):
    """Return a tyre's largest forces (x, y) [N], slip stiffnesses (x, y) [N] and curvatures (x, y)."""
    if car.tyre_model == LINEAR:
        return linear.characteristics(car, wheel, load, friction)
    return pacejka.characteristics(car, wheel, load, friction)


@kernel
def shares(car, slip_x, slip_y, curvature_x, curvature_y):
    """Return force over unsaturated force, longitudinal and lateral, at a vector of normalised slips."""
    slip = math.sqrt(slip_x * slip_x + slip_y * slip_y)
    if slip < 1e-6:
        return 1.0, 1.0
    if car.tyre_model == LINEAR:
        share = linear.curve(slip) / slip
        return share, share
    return (
        pacejka.curve(slip, car.pcx1, curvature_x) / slip,
        pacejka.curve(slip, car.pcy1, curvature_y) / slip,
    )


@kernel
def side_share(car, slip, curvature):
    """Return lateral force over unsaturated force at a normalised slip that is lateral alone."""
    slip = abs(slip)
    if slip < 1e-6:
        return 1.0
    if car.tyre_model == LINEAR:
        return linear.curve(slip) / slip
    return pacejka.curve(slip, car.pcy1, curvature) / slip
