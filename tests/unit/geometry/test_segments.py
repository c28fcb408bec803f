import math

import numpy as np
import pytest

from smarts.geometry import segments
from smarts.geometry.frames import wrap_angle


def test_project_beside_a_segment():
    share, square, cross = segments.project(3.0, 4.0, 0.0, 0.0, 10.0, 0.0)
    assert (share, square, cross) == pytest.approx((0.3, 16.0, 40.0))


@pytest.mark.parametrize(
    ("x", "y", "inside"), [(1, 1, True), (3, 3, False), (3, 1, True), (-1, 1, False), (1, 5, False)]
)
def test_inside_an_l_shape(x, y, inside):
    outline = np.array([[9.0, 9.0], [0, 0], [4, 0], [4, 2], [2, 2], [2, 4], [0, 4], [9.0, 9.0]])
    assert segments.inside_outline(x, y, outline, 1, 7) is inside


def test_interpolate_angle_takes_the_shorter_turn():
    assert segments.interpolate_angle(3.0, -3.0, 0.5) == pytest.approx(math.pi)
    assert segments.interpolate_angle(0.2, -0.2, 0.25) == pytest.approx(0.1)


def test_wrapped_half_open_equals_wrap_angle():
    angles = [*np.linspace(-20.0, 20.0, 1001).tolist(), math.pi, -math.pi, 3 * math.pi]
    assert [segments.wrapped_half_open(angle) for angle in angles] == [wrap_angle(angle) for angle in angles]


def test_wrapped_is_equivalent_and_keeps_small_angles():
    inside = [*np.linspace(-3.14, 3.14, 101).tolist(), 1e-17, -math.pi]
    assert [segments.wrapped(turn) for turn in inside] == inside
    assert segments.wrapped(math.pi) == -math.pi
    assert segments.wrapped(7.0) == pytest.approx(7.0 - 2 * math.pi)
    assert segments.wrapped(-10.0) == pytest.approx(4 * math.pi - 10.0)


@pytest.mark.parametrize(("s", "segment"), [(-1.0, 2), (0.0, 2), (0.9, 2), (1.0, 3), (2.5, 4), (9.0, 4)])
def test_segment_at(s, segment):
    stations = np.array([0.0, 5.0, 0.0, 1.0, 2.0, 3.0, 0.0])
    assert segments.segment_at(stations, 2, 6, s) == segment
