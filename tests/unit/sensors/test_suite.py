"""Which agents share a sensor, and which are observed."""

import numpy as np

from smarts.agents import AgentInterface, NeighborhoodVehicles
from smarts.sensors.suite import SensorSuite
from tests.unit.sensors.seeing import STRAIGHT_ON, at_crossing, scene_of
from tests.worlds import Car

NEAR = AgentInterface(neighborhood_vehicle_states=NeighborhoodVehicles(radius=10.0), lane_positions=False)
FAR = AgentInterface(neighborhood_vehicle_states=True, accelerometer=False, lane_positions=False)


def suite_of(*interfaces):
    made = at_crossing(
        Car(-50.0, -1.6, speed=1.0, mission=STRAIGHT_ON),
        Car(-35.0, -1.6, speed=2.0, mission=STRAIGHT_ON),
        Car(-20.0, -1.6, speed=3.0, mission=STRAIGHT_ON),
    )
    return made.world, SensorSuite(scene_of(made), interfaces)


def wanted(*agents):
    return np.isin(np.arange(4), agents)[None]


def test_equal_options_share_a_block():
    _, suite = suite_of(NEAR, FAR, NEAR, None)
    readings = suite.observe(wanted(0, 1, 2))
    assert {name: agents.tolist() for name, agents in readings.agent_ids.items()} == {
        "ego_vehicle_state": [0, 1, 2],
        "mission": [0, 1, 2],
        "via_data": [0, 1, 2],
        "neighborhood_vehicle_states": [0, 2],
        "neighborhood_vehicle_states:2": [1],
        "accelerometer": [0, 2],
    }
    assert readings.blocks["neighborhood_vehicle_states"]["count"].tolist() == [[0, 0]]
    assert readings.blocks["neighborhood_vehicle_states:2"]["count"].tolist() == [[2]]
    assert readings.blocks["ego_vehicle_state"]["speed"].tolist() == [[1, 2, 3]]


def test_only_the_wanted_are_served():
    world, suite = suite_of(NEAR, FAR, NEAR, None)
    suite.observe(wanted(0, 1, 2))
    world.vehicles.speed[0, :3] = 9.0
    assert suite.observe(wanted(1)).blocks["ego_vehicle_state"]["speed"].tolist() == [[1, 9, 3]]
    assert suite.observe(wanted()).blocks["ego_vehicle_state"]["speed"].tolist() == [[1, 9, 3]]


def test_only_what_somebody_looks_at_is_observed():
    made = at_crossing(*(Car(x, -1.6, mission=STRAIGHT_ON) for x in (-50.0, -35.0)))
    suite = SensorSuite(scene_of(made), [NEAR, NEAR], {0: (), 1: ("mission", "signals")})
    readings = suite.observe(wanted(0, 1))
    assert [*readings.blocks] == ["mission"]
    assert readings.agent_ids["mission"].tolist() == [1]


def test_egos_share_no_block_with_other_agents():
    made = at_crossing(*(Car(x, -1.6, mission=STRAIGHT_ON) for x in (-50.0, -35.0)))
    made.world.egos = 1
    readings = SensorSuite(scene_of(made), [NEAR, NEAR]).observe(wanted(0, 1))
    assert readings.agent_ids["mission"].tolist() == [0]
    assert readings.agent_ids["mission:2"].tolist() == [1]
