"""The hand-made maps and worlds themselves, which all other tests stand on."""

import math

import numpy as np
import pytest

from smarts.types.mission import AgentMission
from tests import maps
from tests.worlds import Car, world_of


def test_a_straight_road():
    made = world_of([Car(50.0, 3.4), Car(10.0, -0.5, speed=8.0)], maps=[maps.straight()])
    vehicles = made.world.vehicles
    assert vehicles.lane[0, :2].tolist() == [1, 0]
    assert vehicles.lane_position[0, :2] == pytest.approx([50.0, 10.0])
    assert vehicles.lane_offset[0, :2] == pytest.approx([0.2, -0.5])
    assert made.world.before.speed[0, 1] == 8.0


def test_a_bend():
    angle, lane = 1.0, 1
    radius = 30.0 - 3.2 * lane - 0.25
    car = Car(radius * math.cos(angle), radius * math.sin(angle), angle + math.pi / 2)
    made = world_of([car], maps=[maps.bend()])
    vehicles = made.world.vehicles
    assert vehicles.lane[0, 0] == lane
    assert vehicles.lane_position[0, 0] == pytest.approx((30.0 - 3.2) * angle, abs=0.05)
    assert vehicles.lane_offset[0, 0] == pytest.approx(0.25, abs=0.01)


def test_a_way_across_a_crossing():
    graph = maps.crossing()
    mission = AgentMission(route=("west_in", "north_out"))
    made = world_of([Car(-20.0, -1.6, 0.0, mission=mission)], [], maps=[graph])
    agents = made.world.agents
    assert agents.on_route[0, 0]
    assert agents.route_progress[0, 0] == pytest.approx(70.0)
    way = 80.0 - 70.0 + graph.length[graph.lane_of_id(":junction_2_0")] + 80.0
    assert agents.remaining[0, 0] == pytest.approx(way, abs=0.01)
    assert agents.corners_on_road[0, 0] == 4
    made.world.vehicles.position[0, 0] = -5.0, -1.3
    made.advance()
    made.match()
    lane = graph.lane_ids[made.world.vehicles.lane[0, 0]]
    assert lane == ":junction_2_0"
    assert np.isfinite(agents.remaining[0, 0])
