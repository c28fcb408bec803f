import math

import numpy as np
import pytest

from smarts.dynamics import TYRE_MODELS, layout, tyre_models
from smarts.dynamics.layout import peak_slip
from smarts.dynamics.parameters import tyre
from smarts.dynamics.tyre_models import pacejka


@pytest.fixture(params=TYRE_MODELS)
def car(request):
    return layout.pack("passenger", request.param).reshape(1).view(np.recarray)[0]


def force(car, load, friction, slip, slip_angle, wheel=0):
    """Return forces (x, y) [N] at a steady slip and slip angle [rad], both positive forward and left."""
    peak_x, peak_y, stiffness_x, stiffness_y, *curvatures = tyre_models.characteristics(
        car, wheel, load, friction
    )
    force_x, force_y = stiffness_x * slip, stiffness_y * math.tan(slip_angle)
    share_x, share_y = tyre_models.shares(car, force_x / peak_x, force_y / peak_y, *curvatures)
    return share_x * force_x, share_y * force_y


def published_force_x(load, slip):
    """Pure longitudinal Magic Formula of the 205/60 R15 set, as its publisher writes it, at its own
    friction."""
    excess = (load - 4000.0) / 4000.0
    peak = (1.0422 - 0.08285 * excess) * load
    stiffness = load * (21.687 + 13.728 * excess) * math.exp(-0.4098 * excess)
    curvature = 0.11113 + 0.3143 * excess
    b = stiffness / (1.579 * peak)
    return peak * math.sin(1.579 * math.atan(b * slip - curvature * (b * slip - math.atan(b * slip))))


def published_force_y(load, slip_angle):
    """Pure lateral Magic Formula of the same set."""
    excess = (load - 4000.0) / 4000.0
    peak = (0.8785 - 0.06452 * excess) * load
    stiffness = 15.324 * 4000.0 * math.sin(2.0005 * math.atan(load / (1.715 * 4000.0)))
    curvature = -0.8057 - 0.6046 * excess
    b, x = stiffness / (1.338 * peak), math.tan(slip_angle)
    return peak * math.sin(1.338 * math.atan(b * x - curvature * (b * x - math.atan(b * x))))


@pytest.mark.parametrize("load", [1500.0, 4000.0, 6000.0])
def test_pure_slip_is_the_published_magic_formula(load):
    car = layout.pack("passenger", "pacejka").reshape(1).view(np.recarray)[0]
    friction = float(car.static_grip[0])
    for slip in (-1.0, -0.1, 0.01, 0.05, 0.3):
        assert force(car, load, friction, slip, 0.0) == pytest.approx((published_force_x(load, slip), 0.0))
        assert force(car, load, friction, 0.0, slip) == pytest.approx((0.0, published_force_y(load, slip)))


def test_force_never_leaves_the_friction_ellipse_and_reaches_it(car):
    load, friction = 3000.0, 0.8
    peak_x, peak_y, *_ = tyre_models.characteristics(car, 0, load, friction)
    used = [
        math.hypot(fx / peak_x, fy / peak_y)
        for slip in np.linspace(-1.0, 1.0, 41)
        for angle in np.linspace(-1.2, 1.2, 41)
        for fx, fy in [force(car, load, friction, slip, angle)]
    ]
    assert max(used) <= 1.0 + 1e-12
    assert max(used) > 0.99


def test_linear_is_linear_until_it_slides():
    car = layout.pack("passenger", "linear").reshape(1).view(np.recarray)[0]
    small, _ = force(car, 3000.0, 0.9, 0.01, 0.0)
    assert force(car, 3000.0, 0.9, 0.02, 0.0)[0] == pytest.approx(2.0 * small)
    assert force(car, 3000.0, 0.9, 0.9, 0.0)[0] == pytest.approx(2700.0)


@pytest.mark.parametrize("name", ["passenger_205_60_r15", "truck_315_80_r22_5"])
def test_peak_slip_is_where_the_curve_is_largest(name):
    curve = tyre(name).longitudinal
    found = peak_slip(curve.pcx1, curve.pex1)
    slips = np.linspace(0.01, 10.0, 100_000)
    values = [pacejka.curve(slip, curve.pcx1, curve.pex1) for slip in slips]
    assert found == pytest.approx(slips[int(np.argmax(values))], rel=0.01)
    assert pacejka.curve(found, curve.pcx1, curve.pex1) == pytest.approx(1.0)
