"""Interfaces: presets, old names, and what they refuse."""

import copy
import math
import pickle

import numpy as np
import pytest

from smarts.agents import (
    OGM,
    RGB,
    ActionSpaceType,
    AgentInterface,
    AgentsAliveDoneCriteria,
    AgentsListAlive,
    AgentType,
    BasicLidar,
    DoneCriteria,
    EventConfiguration,
    InterestDoneCriteria,
    InterfaceError,
    Lidar,
    NeighborhoodVehicles,
    OcclusionMap,
    RoadWaypoints,
    SensorParams,
    Signals,
    VelodyneHDL32E,
    Waypoints,
)
from smarts.types.vehicles import VehicleKind
from tests.raising import raises

ALWAYS = {"accelerometer", "lane_positions"}
PATHS, OTHERS = {"waypoint_paths"}, {"waypoint_paths", "neighborhood_vehicle_states"}
PICTURES = {"drivable_area_grid_map", "occupancy_grid_map", "top_down_rgb", "lidar_point_cloud"}

PRESETS = {
    "Buddha": (ActionSpaceType.Empty, set()),
    "Full": (ActionSpaceType.Continuous, {*OTHERS, *PICTURES, "road_waypoints", "signals"}),
    "Standard": (ActionSpaceType.ActuatorDynamic, OTHERS),
    "Laner": (ActionSpaceType.Lane, PATHS),
    "Loner": (ActionSpaceType.Continuous, PATHS),
    "Tagger": (ActionSpaceType.Continuous, OTHERS),
    "StandardWithAbsoluteSteering": (ActionSpaceType.Continuous, OTHERS),
    "LanerWithSpeed": (ActionSpaceType.LaneWithContinuousSpeed, PATHS),
    "Tracker": (ActionSpaceType.Trajectory, PATHS),
    "Boid": (ActionSpaceType.MultiTargetPose, OTHERS),
    "MPCTracker": (ActionSpaceType.MPC, PATHS),
    "TrajectoryInterpolator": (ActionSpaceType.TrajectoryWithTime, set()),
    "Direct": (ActionSpaceType.Direct, {"neighborhood_vehicle_states", "signals"}),
}


def test_there_are_thirteen_types():
    assert len(AgentType) == 13
    assert {kind.name for kind in AgentType} == set(PRESETS)


@pytest.mark.parametrize("name", PRESETS)
def test_presets(name):
    interface = AgentInterface.from_type(AgentType[name], max_episode_steps=7)
    action, sensors = PRESETS[name]
    assert interface.action is action
    assert set(interface.sensors) == sensors | ALWAYS
    assert interface.max_episode_steps == 7


def test_defaults_are_the_originals():
    interface = AgentInterface()
    assert set(interface.sensors) == ALWAYS
    assert interface.action is None
    assert interface.vehicle_class == "generic_sedan"
    assert interface.vehicle_kind is VehicleKind.PASSENGER
    assert interface.event_configuration.not_moving_time == 60
    done = interface.done_criteria
    assert (done.collision, done.off_road, done.off_route) == (True, True, True)
    assert (done.on_shoulder, done.wrong_way, done.not_moving) == (False, False, False)
    assert (Waypoints().lookahead, Signals().lookahead) == (32, 100.0)
    assert (RGB().width, RGB().height, RGB().resolution) == (256, 256, 50 / 256)
    assert NeighborhoodVehicles().radius is None


def test_lidars():
    assert Lidar().sensor_params is BasicLidar
    assert (BasicLidar.rays_around, len(BasicLidar.laser_angles)) == (6, 50)
    assert (VelodyneHDL32E.rays_around, len(VelodyneHDL32E.laser_angles)) == (36, 24)
    assert SensorParams(0, 6.3, [0, 1], 1, 5, 0, 0).laser_angles == (0.0, 1.0)


def test_old_names_are_understood():
    old = AgentInterface(waypoints=Waypoints(9), neighborhood_vehicles=True, ogm=True, rgb=True, lidar=True)
    new = AgentInterface(
        waypoint_paths=Waypoints(9),
        neighborhood_vehicle_states=True,
        occupancy_grid_map=True,
        top_down_rgb=True,
        lidar_point_cloud=True,
    )
    assert old == new
    assert hash(old) == hash(new)
    assert old.waypoints == old.waypoint_paths == Waypoints(9)
    assert old.replace(ogm=False, waypoints=True).sensors.keys() == new.sensors.keys() - {
        "occupancy_grid_map"
    }
    assert AgentInterface(vehicle_type="bus").vehicle_kind is VehicleKind.BUS
    assert new.requires_rendering
    assert AgentInterface(action=ActionSpaceType.Lane).action_space is ActionSpaceType.Lane


def test_interfaces_travel():
    interface = AgentInterface.from_type(AgentType.Full, occlusion_map=True)
    assert pickle.loads(pickle.dumps(interface)) == interface == copy.deepcopy(interface)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"waypoint_paths": 32}, "waypoint_paths is 32"),
        ({"waypoints": True, "waypoint_paths": True}, "both 'waypoints' and 'waypoint_paths'"),
        ({"top_down_rgb": OGM()}, "top_down_rgb is OGM"),
        ({"action": "lane"}, "'lane'"),
        ({"vehicle_class": "bsu"}, "bus"),
        ({"vehicle_model": "bulet"}, "bullet"),
        ({"tyre_model": "pacejca"}, "pacejka"),
        ({"flat_tyres": (4,)}, "front left"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
        ({"max_steps": 5}, "no field 'max_steps'\n  remedy: did you mean 'max_episode_steps'"),
        ({"max_episode_steps": math.nan}, "max_episode_steps is nan"),
        ({"max_episode_steps": 1.5}, "give a whole number from 1"),
        ({"max_episode_steps": 10**30}, "give a whole number from 1"),
        ({"max_episode_steps": True}, "max_episode_steps is True"),
        ({"done_criteria": None}, "done_criteria is None\n  remedy: give DoneCriteria(...)"),
        ({"event_configuration": {}}, "event_configuration is {}"),
        ({"vehicle_class": None}, "no vehicle class None"),
        ({"vehicle_class": []}, "no vehicle class []"),
        ({"flat_tyres": 3}, "flat_tyres is 3"),
        ({"flat_tyres": "01"}, "flat_tyres is '01'"),
        ({"flat_tyres": (3.0,)}, "flat_tyres is (3.0,)"),
        ({"custom_renders": (1,)}, "OpenGL"),
        ({"occlusion_map": True}, "OGM(width=256"),
        ({"occlusion_map": OcclusionMap(64, 64), "ogm": OGM(64, 32)}, "same size"),
    ],
)
def test_what_is_wrong_is_said(wrong, said):
    with pytest.raises(InterfaceError) as caught:
        AgentInterface(**wrong)
    assert said in str(caught.value)


RAYS = {"start_angle": 0.0, "end_angle": 6.0, "laser_angles": (0.0,), "angle_resolution": 1.0}
RAYS |= {"max_distance": 20.0, "noise_mu": 0.0, "noise_sigma": 0.0}
ALIVE = {"agents_list": (), "minimum_agents_alive_in_list": 1}
REQUIRED = {SensorParams: RAYS, AgentsListAlive: ALIVE}


@pytest.mark.parametrize(
    ("option", "name", "wrong"),
    [
        *((RGB, "width", value) for value in (0, 10.5, "a", None, 4096, True)),
        *((OGM, "resolution", value) for value in (0.0, math.nan, 1e300, 1e-300, "1")),
        *((Waypoints, "lookahead", value) for value in (0, 1.5, math.nan, None, 10**12, True)),
        (Waypoints, "paths", 10**7),
        *((Waypoints, "spacing", value) for value in ("1", 0.0, math.inf)),
        *((RoadWaypoints, "horizon", value) for value in (1.5, -1, 10**10)),
        *((NeighborhoodVehicles, "radius", value) for value in (-1.0, math.nan, "x")),
        *((NeighborhoodVehicles, "most", value) for value in (0, 1.5, 10**12)),
        *((Signals, "lookahead", value) for value in (0, math.nan)),
        (Signals, "most", 2.5),
        *((Lidar, "sensor_params", value) for value in (None, "BasicLidar")),
        *((SensorParams, "end_angle", value) for value in (math.nan, math.inf)),
        *((SensorParams, "laser_angles", value) for value in ((math.nan,), "abc", (None,), None)),
        *((SensorParams, "angle_resolution", value) for value in (0.0, 1e-12, 1e-310, 100.0)),
        *((EventConfiguration, "not_moving_time", value) for value in (math.nan, "x", -1)),
        *((EventConfiguration, "not_moving_distance", value) for value in (math.nan, -1, None)),
        *((DoneCriteria, name, 3) for name in ("agents_alive", "interest", "collision")),
        *((AgentsAliveDoneCriteria, "minimum_ego_agents_alive", value) for value in ("x", -1, 1.5)),
        *((AgentsAliveDoneCriteria, "agent_lists_alive", value) for value in ("ego", [3])),
        *((AgentsListAlive, "agents_list", value) for value in ("ego", [3])),
        *((InterestDoneCriteria, "actors_filter", value) for value in ("ego*", ["["], [3])),
        (InterestDoneCriteria, "strict", "no"),
    ],
)
def test_options_that_cannot_be(option, name, wrong):
    with pytest.raises(InterfaceError) as caught:
        option(**REQUIRED.get(option, {}) | {name: wrong})
    assert caught.value.place == option.__name__
    assert name in caught.value.problem or "rays around" in caught.value.problem
    assert caught.value.remedy.startswith("give ")


def test_numbers_of_numpy_are_numbers():
    option = Waypoints(lookahead=np.int64(9), spacing=np.float32(2.0))
    assert AgentInterface(waypoints=option, max_episode_steps=np.int32(5)).sensors["waypoint_paths"] == option
    assert EventConfiguration(np.float64(3.0), 0).not_moving_time == 3.0


@pytest.mark.parametrize("digits", [400, 5000])
def test_numbers_larger_than_any_float(digits):
    # Python prints no number of more than 4300 digits.
    said = "1000" if digits < 4300 else "of type int, with thousands of digits"
    with raises(InterfaceError, "NeighborhoodVehicles", values=["radius", said]):
        NeighborhoodVehicles(radius=10**digits)
    with raises(InterfaceError, "Signals", values=["lookahead", said]):
        Signals(lookahead=10**digits)
    with raises(InterfaceError, "AgentInterface", values=["max_episode_steps", said]):
        AgentInterface(max_episode_steps=10**digits)
    for name in RAYS:
        with raises(InterfaceError, values=[name]):
            SensorParams(**RAYS | {name: (10**digits,) if name == "laser_angles" else 10**digits})
    said = said.replace("int", "tuple").replace("1000", "(1000")
    with raises(InterfaceError, "flat_tyres", values=[said]):
        AgentInterface(flat_tyres=(10**digits,))


def test_numbers_become_those_of_python():
    # Kernels take neither half nor long ones, nor whole ones beyond 64 bits; small whole ones overflow.
    for given in (np.float16(3), np.longdouble(3), 3, 2**70):
        assert type(Signals(lookahead=given).lookahead) is float
        assert type(NeighborhoodVehicles(radius=given).radius) is float
    assert type(Waypoints(spacing=np.float16(3)).spacing) is float
    assert type(OGM(resolution=np.float16(3)).resolution) is float
    assert type(RoadWaypoints(horizon=np.int8(100)).horizon) is int
    assert type(AgentInterface(max_episode_steps=np.int8(100)).max_episode_steps) is int


def test_unknown_types():
    with raises(InterfaceError, values=["Buddha"]):
        AgentInterface.from_type("Lanner")
    with raises(InterfaceError, values=["Buddha"]):
        AgentInterface.from_type([])
