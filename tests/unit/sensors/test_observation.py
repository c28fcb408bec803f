"""Observations as objects: names, numbers, and that they outlive their frame."""

import math
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

from smarts.agents import RGB, AgentInterface, AgentType
from smarts.env.observation_collector import ObservationCollector
from smarts.roads.scene import Scene
from smarts.sensors.observation import ObservationMaker
from smarts.sensors.signals import SignalLightState
from smarts.sensors.suite import SensorSuite
from smarts.types.agent_states import AgentStatus
from smarts.types.coordinates import Dimensions
from smarts.types.events import Contacts, Event, Events
from smarts.types.frame import Frame
from smarts.types.mission import AgentMission, GoalKind, Via
from smarts.types.traffic import Signal
from tests.maps import crossing
from tests.worlds import Car, world_of

VIA = Via((-20.0, -1.6), lane=1, radius=2.0, speed=8.0)
MISSION = AgentMission(
    ("west_in", "north_out"), GoalKind.POSITION, (1.6, 80.0), goal_radius=3.0, route_length=110.0, vias=(VIA,)
)
CARS = (
    Car(-30.0, -1.6, 0.0, 5.0, MISSION, name="ego"),
    Car(-50.0, -1.6, 0.0, 4.0, MISSION, name="second"),
    Car(-22.0, 1.6, math.pi, 3.0, name="oncoming"),
)


class Stage:
    """A world with sensors, and frames of it."""

    def __init__(self, *interfaces):
        self.made = world_of(CARS, maps=[crossing()])
        scene = Scene(self.made.world, self.made.atlas, self.made.routes)
        self.suite = SensorSuite(scene, [*interfaces, *[None] * (4 - len(interfaces))])
        self.contacts, self.events = Contacts.allocate(1, 4, 16), Events.allocate(1, 4)
        self.parts = SimpleNamespace(scene=scene, ownership=self.made.ownership)
        self.maker = ObservationMaker(scene)
        self.wanted = np.array([[index < len(interfaces) for index in range(4)]])

    def frame(self):
        world = self.made.world
        readings = self.suite.observe(self.wanted)
        rows = np.ones(1, np.bool_)
        return Frame(world, rows, None, None, self.contacts, self.events, self.wanted, readings)

    def look(self, agent_id=0, **more):
        return self.maker(self.frame(), 0, agent_id, **more)


FULL = AgentInterface.from_type(AgentType.Full, rgb=RGB(32, 16, 1.0))


def test_the_own_vehicle():
    stage = Stage(FULL)
    stage.made.world.vehicles.acceleration[0, 0] = 1.5
    ego = stage.look().ego_vehicle_state
    assert ego.id == "ego"
    assert ego.position == (-30.0, -1.6, 0.0)
    assert ego.bounding_box == pytest.approx(Dimensions(5.0, 1.8, 1.5))
    assert (ego.road_id, ego.edge_id, ego.lane_id, ego.lane_index) == ("west_in", "west_in", "west_in_0", 0)
    assert ego.linear_velocity == (5.0, 0.0, 0.0)
    assert ego.linear_acceleration == (1.5, 0.0, 0.0)
    assert ego.lane_position.s == pytest.approx(60.0)
    goal = ego.mission.goal
    assert goal.is_specific()
    assert (goal.position.x, goal.position.y, goal.radius) == (1.6, 80.0, 3.0)
    assert ego.mission.route_length == 110.0


def test_others_signals_and_vias():
    stage = Stage(FULL)
    graph = stage.made.atlas.graphs[0]
    way = next(n for n in graph.successors(1) if graph.lane_ids[graph.successors(n)[0]] == "north_out_0")
    stage.made.world.signals[0, way] = Signal.GO
    seen = stage.look()
    assert [(near.id, near.speed, near.lane_id) for near in seen.neighborhood_vehicle_states] == [
        ("oncoming", 3.0, "west_out_0"),
        ("second", 4.0, "west_in_0"),
    ]
    assert seen.signals[0].state == SignalLightState.GO
    assert seen.signals[0].stop_point[:2] == pytest.approx((-10.0, -1.6))
    assert seen.signals[0].controlled_lanes == (graph.lane_ids[way],)
    via = seen.via_data.near_via_points[0]
    assert (via.position, via.road_id, via.lane_index, via.required_speed) == ((-20.0, -1.6), "west_in", 0, 8)
    assert seen.via_data.hit_via_points == ()


def test_waypoints():
    seen = Stage(FULL).look()
    (path,) = seen.waypoint_paths
    assert len(path) == 32
    assert path[4].pos == pytest.approx([-26.0, -1.6])
    assert path[4].lane_id == "west_in_0"
    assert path[4].signed_lateral_error((0.0, 1.0)) == pytest.approx(2.6)
    assert path[4].relative_heading(0.3) == pytest.approx(-0.3)
    assert path[4].dist_to((-26.0, 1.4)) == pytest.approx(3.0)
    lanes = seen.road_waypoints.lanes
    assert set(lanes) == {"west_in_0", "west_out_0"}
    assert len(lanes["west_out_0"][0]) == 41


def test_pictures_and_points():
    seen = Stage(FULL).look()
    picture = seen.top_down_rgb
    assert picture.data.shape == (16, 32, 3)
    assert (picture.metadata.width, picture.metadata.height, picture.metadata.resolution) == (32, 16, 1.0)
    assert picture.metadata.camera_position == (-30.0, -1.6, 0.0)
    assert seen.drivable_area_grid_map.data.any()
    assert seen.occupancy_grid_map.data.any()
    points, hits, rays = seen.lidar_point_cloud
    assert len(points) == len(hits) == len(rays) == 300
    assert all(np.isinf(point).all() != hit for point, hit in zip(points, hits, strict=True))
    assert rays[0][0] == pytest.approx([-30.0, -1.6, 1.8])
    assert np.linalg.norm(rays[0][1]) == pytest.approx(20.0)


def test_events_and_time():
    stage = Stage(FULL)
    world = stage.made.world
    world.step[0], world.agents.entry_step[0, 0], world.agents.distance_travelled[0, 0] = 25, 5, 12.0
    stage.events.bits[0, 0] = Event.OFF_ROUTE
    stage.contacts.touching[0, 0, 2] = True
    seen = stage.look()
    assert (seen.step_count, seen.steps_completed, seen.dt) == (25, 20, 0.1)
    assert seen.elapsed_sim_time == pytest.approx(2.5)
    assert seen.distance_travelled == 12.0
    assert seen.under_this_agent_control
    assert [collision.collidee_id for collision in seen.events.collisions] == ["oncoming"]
    assert seen.events.off_route
    assert not seen.events.reached_goal
    assert stage.look(events=int(Event.REACHED_GOAL)).events.reached_goal
    world.agents.state[0, 0] = AgentStatus.SHADOWING
    assert not stage.look().under_this_agent_control


def test_an_observation_outlives_its_frame():
    stage = Stage(FULL)
    seen = stage.look()
    stage.made.world.vehicles.position[0, 0] += 10.0
    stage.made.world.registry.dismiss(0, 2)
    stage.frame()
    assert seen.ego_vehicle_state.position[0] == -30.0
    assert seen.neighborhood_vehicle_states[0].id == "oncoming"
    assert pickle.loads(pickle.dumps(seen)).ego_vehicle_state == seen.ego_vehicle_state


def test_collisions_are_those_of_all_steps_of_a_decision():
    stage = Stage(FULL)
    onlooker = ObservationCollector(stage.parts.scene, [0])
    touching = stage.contacts.touching
    collisions = []
    for step, slots in enumerate([(2,), (1, 2), (), (), (), ()]):
        touching[0, 0] = False
        touching[0, 0, list(slots)] = True
        onlooker.collect(stage.frame(), step % 3 == 2)
        if step % 3 == 2:
            collisions.append([each.collidee_id for each in onlooker.seen[0].events.collisions])
    assert collisions == [["oncoming", "second"], []]
