"""How fast vehicles drive through junctions, by hand."""

import math

import numpy as np
import pytest

from smarts.dynamics.performance import performance
from smarts.roads.atlas import RoadAtlas
from smarts.roads.paces import Performance, acceleration_over, pace_in
from smarts.types.vehicles import VehicleKind
from tests.maps import bend, straight


@pytest.mark.parametrize(
    ("distance", "speed", "top", "expected"),
    [
        (10.0, 0.0, 14.0, 1.9),  # 4.5 m/s halfway: the engine's force limits it, not its power
        (25.0, 10.0, 20.0, 12.0 / math.sqrt(150.0)),
        (25.0, 10.0, 10.0, 1.2),
    ],
)
def test_power_limits_the_acceleration_at_speed(distance, speed, top, expected):
    heavy = Performance(np.array([1.9]), np.array([12.0]), np.array([0.05]))
    assert acceleration_over(heavy, 0, distance, speed, top) == pytest.approx(expected)


def test_strong_vehicles_do_not_use_all_of_their_power():
    strong = Performance(np.array([11.0]), np.array([84.0]), np.array([0.15]))
    assert acceleration_over(strong, 0, 20.0, 5.0, 14.0) == 2.0


def test_what_the_kinds_can_do():
    """A bus: 30,000 N, 188 kW, 14,860 kg, steering 0.4 rad/s, axles 7.184 m apart."""
    found = performance()
    bus = [column[VehicleKind.BUS] for column in found]
    assert bus == pytest.approx([30_000 / 14_860 - 0.008 * 9.81, 188_000 / 14_860, 0.4 / 7.184])
    assert np.isinf(found.power[VehicleKind.TRAILER])


def test_straight_lanes_are_driven_at_their_limit():
    assert pace_in(RoadAtlas([straight()]).roads, 0, 1e-6) == 14.0


def test_bends_and_the_steering_limit_the_pace():
    """A quarter circle of 30 m, 47.1 m long: sqrt(3 * 30) m/s = 9.49 m/s, and more near its ends.

    There the bend, measured over 4 m, is smaller: by a half, then by a quarter. One whose steering is slow
    drives with 2 m/s for 5 m at either end, where the bend changes.
    """
    roads, fast = RoadAtlas([bend()]).roads, math.sqrt(90.0)
    ends = 1 / math.sqrt(180.0) + 1 / math.sqrt(120.0)
    assert pace_in(roads, 0, 10.0) == pytest.approx(48 / (44 / fast + 2 * ends), rel=2e-3)
    assert pace_in(roads, 0, 1e-3) == pytest.approx(48 / (10 / 2.0 + 38 / fast), rel=1e-2)
