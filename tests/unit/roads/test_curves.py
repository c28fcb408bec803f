"""Curves into lanes, against circles and cubics on paper."""

import math

import numpy as np
import pytest

from smarts.roads.atlas import RoadAtlas
from smarts.roads.curves import curve_into, pose_along, pose_on, sharpest_bend, station_near, stations_of
from tests.maps import Road, graph_of

WIDE = 12.8
"""From the lane to the east to that to the west [m]."""


@pytest.fixture(scope="module")
def roads():
    """Lane 0 leads east along the x axis, lane 1 west, `WIDE` to the left; both are 200 m long."""
    ways = {"there": Road([(0, 0), (200, 0)]), "back": Road([(200, WIDE), (0, WIDE)])}
    return RoadAtlas([graph_of(ways)]).roads


def turn(roads):
    """Return the curve from (50, 0) round to (50, WIDE)."""
    return curve_into(roads, np.array([50.0, 0.0, 0.0]), 1, 150.0)


def test_a_half_turn_is_nearly_a_half_circle(roads):
    control = turn(roads)
    assert pose_on(control, 0.0) == pytest.approx((50.0, 0.0, 0.0))
    assert pose_on(control, 0.5) == pytest.approx((50.0 + WIDE / 2, WIDE / 2, math.pi / 2))
    x, y, heading = pose_on(control, 1.0)
    assert (x, y, abs(heading)) == pytest.approx((50.0, WIDE, math.pi))
    away = [math.hypot(*(np.array(pose_on(control, u)[:2]) - (50.0, WIDE / 2))) for u in np.linspace(0, 1)]
    assert np.ptp([*away, WIDE / 2]) < 0.02 * WIDE
    stations = stations_of(control)
    assert stations[-1] == pytest.approx(math.pi * WIDE / 2, rel=0.01)
    assert sharpest_bend(control, stations) == pytest.approx(2 / WIDE, rel=0.15)


def test_a_lane_change_is_the_smooth_cubic(roads):
    # From 3 m to the right of the lane: y = -3 + 3 (3 u^2 - 2 u^3) at x = 50 + 30 u.
    control = curve_into(roads, np.array([50.0, -3.0, 0.0]), 0, 80.0)
    for u in (0.0, 0.25, 0.5, 0.9):
        x, y, _ = pose_on(control, u)
        assert (x, y) == pytest.approx((50.0 + 30.0 * u, -3.0 + 3.0 * (3 * u**2 - 2 * u**3)), abs=0.03)
    # Its second derivative is 6 * 3 / 30^2 at the ends, where the slope is 0.
    assert sharpest_bend(control, stations_of(control)) == pytest.approx(18 / 900, rel=0.05)


def test_places_along_a_curve(roads):
    control = turn(roads)
    stations = stations_of(control)
    for station in (0.0, 3.0, 10.0, stations[-1]):
        x, y, _ = pose_along(control, stations, station)
        assert station_near(control, stations, x, y) == pytest.approx((station, 0.0), abs=0.02)
    assert station_near(control, stations, 50.0 + WIDE / 2 + 1.0, WIDE / 2)[1] == pytest.approx(1.0, abs=0.02)
    # Before the begin it is 0, and 3 m beyond the end that much more than the length.
    assert station_near(control, stations, 47.0, 0.0) == pytest.approx((0.0, 3.0))
    assert station_near(control, stations, 47.0, WIDE)[0] == pytest.approx(stations[-1] + 3.0, abs=0.01)
