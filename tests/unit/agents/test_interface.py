"""Interfaces: presets, old names, and what they refuse."""

import copy
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
    InterestDoneCriteria,
    InterfaceError,
    Lidar,
    NeighborhoodVehicles,
    OcclusionMap,
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


def test_presets():
    assert {kind.name for kind in AgentType} == set(PRESETS)
    for name, (action, sensors) in PRESETS.items():
        interface = AgentInterface.from_type(AgentType[name], max_episode_steps=7)
        found = interface.action, set(interface.sensors), interface.max_episode_steps
        assert found == (action, sensors | ALWAYS, 7), name


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


def test_none_switches_a_sensor_off():
    assert AgentInterface(waypoint_paths=None, ogm=None) == AgentInterface()  # type: ignore[arg-type]


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
        ({"action": "lane"}, "an instance of ActionSpaceType"),
        ({"vehicle_class": "bsu"}, "'bus'"),
        ({"vehicle_model": "bulet"}, "'bullet'"),
        ({"flat_tyres": (4,)}, "flat_tyres is 4"),
        ({"max_episode_steps": 1.5}, "max_episode_steps is 1.5"),
        ({"max_steps": 5}, "no field 'max_steps'\n  remedy: did you mean 'max_episode_steps'"),
        ({"done_criteria": None}, "an instance of DoneCriteria"),
        ({"custom_renders": (1,)}, "OpenGL"),
        ({"occlusion_map": OcclusionMap(64, 32), "ogm": OGM(32, 64)}, "same size"),
    ],
)
def test_what_is_wrong_is_said(wrong, said):
    with raises(InterfaceError, values=[said]):
        AgentInterface(**wrong)


@pytest.mark.parametrize(
    ("option", "values", "said"),
    [
        (RGB, {"width": 0}, "width is 0"),
        (Waypoints, {"lookahed": 9}, "'lookahead'"),
        (NeighborhoodVehicles, {"radius": "x"}, "radius is 'x'"),
        (Lidar, {"sensor_params": "BasicLidar"}, "an instance of SensorParams"),
        (DoneCriteria, {"collision": 3}, "collision is 3"),
        (AgentsListAlive, {"agents_list": "ego", "minimum_agents_alive_in_list": 1}, "agents_list is 'ego'"),
        (AgentsListAlive, {"agents_list": []}, "minimum_agents_alive_in_list is missing"),
        (AgentsAliveDoneCriteria, {"agent_lists_alive": [3]}, "agent_lists_alive is 3"),
        (InterestDoneCriteria, {"actors_filter": ["["]}, "'['"),
    ],
)
def test_options_that_cannot_be(option, values, said):
    with raises(InterfaceError, option.__name__, values=[said]):
        option(**values)


def test_a_lidar_of_too_many_rays():
    with raises(InterfaceError, "SensorParams", values=["6000000000000"]):
        SensorParams(0.0, 6.0, (0.0,), 1e-12, 20.0, 0.0, 0.0)


def test_numbers_of_numpy_become_those_of_python():
    """Kernels do not take all types, and small whole numbers overflow."""
    option = Waypoints(np.int8(9), np.float16(2.0))
    assert (option, type(option.lookahead), type(option.spacing)) == (Waypoints(9, 2.0), int, float)
    assert type(Signals(lookahead=3).lookahead) is float
    assert type(AgentInterface(max_episode_steps=np.int32(5)).max_episode_steps) is int


def test_unknown_types():
    with raises(InterfaceError, "AgentInterface.from_type", values=["'Laner'"]):
        AgentInterface.from_type("Lanner")
