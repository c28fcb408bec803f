import math

import numpy as np
import pytest

from smarts.geometry.frames import compass_from_heading, heading_from_compass, wrap_angle


def test_wrap_angle_returns_the_half_open_interval():
    wrapped = wrap_angle(np.linspace(-50, 50, 10_001))
    assert (wrapped > -math.pi).all()
    assert (wrapped <= math.pi).all()
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * np.linspace(-50, 50, 10_001)), atol=1e-12)


@pytest.mark.parametrize(
    ("compass", "heading"), [(0.0, math.pi / 2), (90.0, 0.0), (180.0, -math.pi / 2), (270.0, math.pi)]
)
def test_compass_points(compass, heading):
    assert heading_from_compass(compass) == pytest.approx(heading)
    assert compass_from_heading(heading) == pytest.approx(compass)
