"""The own vehicle's state, place in its lane, accelerations."""

import math

import pytest

from smarts.sensors.accelerometer import AccelerationAndJerk
from smarts.sensors.ego_vehicle_state import EgoVehicleState
from smarts.sensors.lane_positions import LanePosition
from smarts.types.vehicles import VehicleKind
from tests.unit.sensors.seeing import BEND, RADIUS, STRAIGHT_ON, at_crossing, in_bend, on_bend, seen
from tests.worlds import Car


def test_state_in_a_curve():
    made = in_bend(on_bend(0.5, RADIUS - 3.2, speed=10.0, mission=BEND, length=12.0, kind=VehicleKind.BUS))
    made.world.vehicles.lateral_speed[0, 0] = 0.5
    made.world.vehicles.yaw_rate[0, 0] = 10 / (RADIUS - 3.2)
    made.world.agents.steering[0, 0] = 0.1
    made.world.agents.distance_travelled[0, 0] = 12.5
    ego = seen(EgoVehicleState(), made)
    assert ego["position"] == pytest.approx([26.8 * math.cos(0.5), 26.8 * math.sin(0.5), 0.0])
    assert ego["bounding_box"] == pytest.approx([12.0, 1.8, 3.0])
    assert ego["heading"] == pytest.approx(0.5 + math.pi / 2)
    # Along the tangent (-sin, cos), and slipping towards the centre (-cos, -sin).
    velocity = [-10 * math.sin(0.5) - 0.5 * math.cos(0.5), 10 * math.cos(0.5) - 0.5 * math.sin(0.5)]
    assert ego["linear_velocity"] == pytest.approx(velocity, rel=1e-6)
    assert ego["yaw_rate"] == pytest.approx(0.37313, abs=1e-5)
    assert (ego["speed"], ego["steering"]) == pytest.approx((10.0, 0.1))
    assert (ego["lane"], ego["lane_index"]) == (1, 1)
    assert ego["distance_travelled"] == 12.5


def test_place_in_a_curve():
    made = in_bend(on_bend(0.5, RADIUS + 0.5, mission=BEND))
    s, t, h = seen(LanePosition(), made)["lane_position"]
    # The curve is drawn as chords of 1/4 m.
    assert s == pytest.approx(0.5 * RADIUS, abs=0.01)
    assert t == pytest.approx(-0.5, abs=1e-3)
    assert h == 0


def test_acceleration_and_jerk_in_a_steady_curve():
    speed, turn = 10.0, 10.0 / RADIUS * 0.1
    made = in_bend(on_bend(0.5 - turn, speed=speed, mission=BEND))
    vehicles = made.world.vehicles
    vehicles.lateral_acceleration[0, 0] = speed**2 / RADIUS
    made.advance()
    vehicles.heading[0, 0] += turn
    motion = seen(AccelerationAndJerk(), made)
    centripetal = speed**2 / RADIUS
    assert motion["linear_acceleration"] == pytest.approx(
        [-centripetal * math.cos(0.5), -centripetal * math.sin(0.5)], rel=1e-6
    )
    # The direction towards the centre turns: jerk is v^3 / R^2 backwards, in the middle of the step.
    middle = 0.5 - turn / 2
    size = speed**3 / RADIUS**2 * math.sin(turn / 2) / (turn / 2)
    assert motion["linear_jerk"] == pytest.approx(
        [size * math.sin(middle), -size * math.cos(middle)], rel=1e-5
    )
    assert motion["angular_acceleration"] == 0
    assert motion["angular_jerk"] == 0


def test_there_is_no_jerk_from_another_vehicle():
    made = at_crossing(Car(0.0, -1.6, 0.0, 8.0, mission=STRAIGHT_ON))
    made.advance()
    made.world.vehicles.acceleration[0, 0] = -3.0
    made.world.before.generation[0, 0] -= 1
    motion = seen(AccelerationAndJerk(), made)
    assert motion["linear_jerk"].tolist() == [0, 0]
    assert motion["angular_jerk"] == 0
