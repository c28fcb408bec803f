"""The vehicles around."""

import math

import pytest

from smarts.agents.options import NeighborhoodVehicles
from smarts.sensors.neighborhood_vehicle_states import NeighborhoodVehicleStates
from smarts.types.vehicles import VehicleKind
from tests.unit.sensors.seeing import BEND, RADIUS, STRAIGHT_ON, at_crossing, in_bend, on_bend, seen
from tests.worlds import Car


def sensor(**option):
    return NeighborhoodVehicleStates(NeighborhoodVehicles(**option))


def test_nearest_come_first_in_a_curve():
    made = in_bend(
        on_bend(0.2, mission=BEND),
        on_bend(1.2, speed=7.0),
        on_bend(0.3, RADIUS - 3.2, speed=4.0, length=12.0, width=2.5, kind=VehicleKind.BUS),
    )
    near = seen(sensor(), made)
    assert near["count"] == 2
    assert near["slot"][:2].tolist() == [2, 1]
    assert near["generation"][:2].tolist() == [1, 1]
    assert near["position"][0] == pytest.approx([26.8 * math.cos(0.3), 26.8 * math.sin(0.3), 0])
    assert near["bounding_box"][0] == pytest.approx([12.0, 2.5, 3.0])
    assert near["heading"][:2] == pytest.approx([0.3 + math.pi / 2, 1.2 + math.pi / 2])
    assert near["speed"][:2].tolist() == [4, 7]
    assert near["lane"][:2].tolist() == [1, 0]
    assert near["lane_index"][:2].tolist() == [1, 0]
    assert near["lane_position"][0] == pytest.approx([26.8 * 0.3, 0, 0], abs=0.02)
    assert not near["speed"][2:].any()
    assert not near["position"][2:].any()


def test_radius_is_of_the_straight_line():
    # Chords of the circle: 2 R sin(angle / 2) is 20 m at 0.6797 rad.
    made = in_bend(on_bend(0.2, mission=BEND), on_bend(0.87), on_bend(0.89), on_bend(1.5))
    assert seen(sensor(radius=20.0), made)["slot"][:2].tolist() == [1, 0]
    assert seen(sensor(radius=20.0), made)["count"] == 1


def test_of_equally_far_ones_the_lower_slot_comes_first_and_room_is_limited():
    made = at_crossing(
        Car(0, 0, mission=STRAIGHT_ON), Car(0, 30), Car(10, 0), Car(0, -10), Car(-10, 0), Car(0, 5)
    )
    assert seen(sensor(most=3), made)["slot"].tolist() == [5, 2, 3]
