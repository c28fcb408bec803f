"""Interfaces: presets, old names, and what they refuse."""

import numpy as np
import pytest

from smarts.agents import (
    OGM,
    RGB,
    ActionSpaceType,
    AgentInterface,
    AgentsListAlive,
    AgentType,
    InterfaceError,
    NeighborhoodVehicles,
    OcclusionMap,
    Signals,
    Waypoints,
)
from smarts.types.vehicles import VehicleKind
from tests.raising import raises

ALWAYS = {"accelerometer", "lane_positions"}


def test_presets():
    every = {kind.name: AgentInterface.from_type(kind, max_episode_steps=7) for kind in AgentType}
    assert {each.max_episode_steps for each in every.values()} == {7}
    laner, buddha = every["Laner"], every["Buddha"]
    assert (laner.action, {*laner.sensors}) == (ActionSpaceType.Lane, ALWAYS | {"waypoint_paths"})
    assert (buddha.action, {*buddha.sensors}) == (ActionSpaceType.Empty, ALWAYS)
    assert len(every["Full"].sensors) == 10


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


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"waypoint_paths": 32}, "waypoint_paths is 32"),
        ({"action": "lane"}, "an instance of ActionSpaceType"),
        ({"vehicle_class": "bsu"}, "'bus'"),
        ({"vehicle_model": "bulet"}, "'bullet'"),
        ({"max_episode_steps": 1.5}, "max_episode_steps is 1.5"),
        ({"max_steps": 5}, "no field 'max_steps'\n  remedy: did you mean 'max_episode_steps'"),
        ({"occlusion_map": OcclusionMap(64, 32), "ogm": OGM(32, 64)}, "same size"),
        ({"custom_renders": ("shader",)}, "top_down_rgb"),
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
        (AgentsListAlive, {"agents_list": "ego", "minimum_agents_alive_in_list": 1}, "agents_list is 'ego'"),
        (AgentsListAlive, {"agents_list": []}, "minimum_agents_alive_in_list is missing"),
    ],
)
def test_options_that_cannot_be(option, values, said):
    with raises(InterfaceError, option.__name__, values=[said]):
        option(**values)


def test_numbers_of_numpy_become_those_of_python():
    """Kernels do not take all types, and small whole numbers overflow."""
    option = Waypoints(np.int8(9), np.float16(2.0))
    assert (option, type(option.lookahead), type(option.spacing)) == (Waypoints(9, 2.0), int, float)
    assert type(Signals(lookahead=3).lookahead) is float
    assert type(AgentInterface(max_episode_steps=np.int32(5)).max_episode_steps) is int


def test_unknown_types():
    with raises(InterfaceError, "AgentInterface.from_type", values=["'Laner'"]):
        AgentInterface.from_type("Lanner")
