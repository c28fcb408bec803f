"""The Magic Formula: H. B. Pacejka, Tire and Vehicle Dynamics, 3rd ed. 2012, section 4.3.2, without camber.

Friction is scaled (the formula's lambda_mu) so that the road's friction is the largest longitudinal force
over load of a sound tyre at the vehicle's static load; grip's dependence on load, and its lateral part, are
the set's own. Stiffness does not depend on friction, so the peak lies at a smaller slip on a slippery road.
"""

from __future__ import annotations

import math

from smarts.geometry.compiling import kernel


@kernel
def characteristics(car, wheel, load, friction):
    """Return largest forces (x, y) [N], slip stiffnesses (x, y) [N] and curvatures (x, y).

    Args:
        car: A record of `layout.PARAMETERS`.
        wheel: 0 to 3.
        load: On the wheel [N].
        friction: Friction of the road for this tyre.
    """
    nominal = car.nominal_load[wheel]
    excess = load / nominal - 1.0
    scale = friction / car.static_grip[wheel] * load
    # Far above its nominal load a set's fits go wrong: the wheel keeps at least a third of its grip.
    peak_x = scale * max(car.pdx1 + car.pdx2 * excess, car.pdx1 / 3.0)  # 4.E12, 4.E13
    peak_y = scale * max(car.pdy1 + car.pdy2 * excess, car.pdy1 / 3.0)  # 4.E22, 4.E23
    bounded = min(excess, 1.0)
    stiffness_x = load * (car.pkx1 + car.pkx2 * bounded) * math.exp(car.pkx3 * bounded)  # 4.E15
    stiffness_y = -car.pky1 * nominal * math.sin(car.pky4 * math.atan(load / (car.pky2 * nominal)))  # 4.E25
    curvature_x = min(car.pex1 + car.pex2 * bounded + car.pex3 * bounded * bounded, 1.0)  # 4.E14
    curvature_y = min(car.pey1 + car.pey2 * bounded, 1.0)  # 4.E24
    return peak_x, peak_y, stiffness_x, stiffness_y, curvature_x, curvature_y


@kernel
def curve(slip, shape, curvature):
    """Return force over largest force at a normalised slip, 4.E9 with B = 1/C."""
    x = slip / shape
    return math.sin(shape * math.atan(x - curvature * (x - math.atan(x))))
