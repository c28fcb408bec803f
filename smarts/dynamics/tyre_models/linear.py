"""The linear tyre: force proportional to slip up to the friction ellipse, then the ellipse."""

from __future__ import annotations

from smarts.geometry.compiling import kernel


@kernel
def characteristics(car, wheel, load, friction):
    """Return largest forces (x, y) [N], slip stiffnesses (x, y) [N] and two unused curvatures.

    Args:
        car: A record of `layout.PARAMETERS`.
        wheel: 0 to 3.
        load: On the wheel [N].
        friction: Friction of the road for this tyre.
    """
    peak = friction * load
    return peak, peak, car.linear_x[wheel], car.linear_y[wheel], 0.0, 0.0


@kernel
def curve(slip):
    """Return force over largest force at a normalised slip."""
    return min(slip, 1.0)
