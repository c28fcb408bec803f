"""The vocabulary: names, order and defaults that scenario files rely on, and what makes two things one."""

import dataclasses
import importlib
import subprocess
import sys

import pytest

from smarts.errors import ContradictionError
from smarts.sstudio import types as t
from tests.raising import raises

# Positional order and defaults of the original (its newest version; "..." marks required fields). What only
# its older versions had, and our own extensions, come last.
FIELDS = {
    "Distribution": "mean=... sigma=...",
    "UniformDistribution": "a=... b=...",
    "TruncatedDistribution": "a=... b=... loc=0 scale=1",
    "SocialAgentActor": "name=... agent_locator=... policy_kwargs={} initial_speed=None",
    "Route": "begin=... end=... via=() map_spec=None",
    "JunctionEdgeIDResolver": "start_edge_id=... start_lane_index=... end_edge_id=... end_lane_index=...",
    "Via": "road_id=... lane_index=... lane_offset=... required_speed=... hit_distance=-1",
    "Flow": (
        "route=... rate=... begin=0 end=3600 actors={} randomly_spaced=False repeat_route=False stops=()"
    ),
    "Trip": "vehicle_name=... route=... vehicle_type='passenger' depart=0 actor=None stops=()",
    "Traffic": "flows=... trips=None engine='SUMO' warm_up=0.0 seed=None route_files=() "
    "additional_files=() sumo_options={} recording=None",
    "Recording": "source=... mode='reactive' begin=0.0 end=None window=None history=None",
    "Mission": "route=... via=() start_time=MISSING entry_tactic=None task=None",
    "EndlessMission": "begin=... via=() start_time=MISSING entry_tactic=None",
    "LapMission": "route=... num_laps=... via=() start_time=MISSING entry_tactic=None",
    "GroupedLapMission": (
        "route=... offset=... lanes=... actor_count=... num_laps=... via=() entry_tactic=None"
    ),
    "UTurn": "trigger_radius=100 initial_speed=None target_lane_index=0",
    "CutIn": "trigger_radius=30 complete_on_edge_id=None",
    "MapZone": "start=... length=... n_lanes=2",
    "PositionalZone": "pos=... size=... rotation=None",
    "ConfigurableZone": "ext_coordinates=... rotation=None",
    "RoadSurfacePatch": "zone=... begin_time=... end_time=... friction_coefficient=...",
    "BubbleLimits": "hijack_limit=MAX shadow_limit=MAX",
    "MapSpec": (
        "source='.' lanepoint_spacing=1.0 default_lane_width=None shift_to_origin=False builder_fn=None"
        " plain=None"
    ),
    "Stop": "road_id=... lane_index=... offset=... duration=... length=20.0 bus_stop=True",
    "StartVariation": "offset=5.0 speed=(0.0,5.0)",
    "Variation": "description=... map_spec=None traffic=None ego_missions=None seed=None",
}
ORDER = {
    "TrafficActor": (
        "name accel decel tau sigma depart_speed emergency_decel speed imperfection min_gap max_speed"
        " vehicle_type lane_changing_model junction_model reaction_time"
    ),
    "Bubble": (
        "zone actor margin limit exclusion_prefixes id follow_actor_id follow_offset keep_alive"
        " follow_vehicle_id active_condition airlock_condition collision_time"
    ),
    "TrapEntryTactic": (
        "start_time wait_to_hijack_limit_s zone exclusion_prefixes default_entry_speed condition"
    ),
    "IdEntryTactic": "start_time actor_id condition",
    "Scenario": (
        "map_spec traffic ego_missions social_agent_missions bubbles friction_maps traffic_histories"
        " scenario_metadata start_variation held_out"
    ),
    "TrafficHistoryDataset": (
        "name source_type input_path scenario_id x_margin_px y_margin_px swap_xy flip_y filter_off_map"
        " map_lane_width real_lane_width_m speed_limit_mps heading_inference_window"
        " heading_inference_min_speed max_angular_velocity default_heading"
    ),
}
IMPORTS = {
    "smarts.core.colors": "Colors",
    "smarts.sstudio": "gen_bubbles gen_friction_map gen_group_laps gen_missions gen_scenario"
    " gen_social_agent_missions gen_traffic types",
    "smarts.sstudio.genscenario": "gen_agent_missions gen_scenario gen_social_agent_missions gen_traffic",
    "smarts.sstudio.sstypes": "SocialAgentActor",
    **{
        f"smarts.sstudio.{package}.{module}": name
        for package in ("sstypes", "types")
        for module, name in (("entry_tactic", "IdEntryTactic"), ("route", "RandomRoute"), ("traffic", "Trip"))
    },
}
"""All that scenario files of the original import of it, from its version 0.4.16 to its last."""


def test_fields_come_in_order_and_with_defaults():
    for name in FIELDS:
        check_fields(name)
    for name, fields in ORDER.items():
        assert [field.name for field in dataclasses.fields(getattr(t, name))] == fields.split()


def check_fields(name):
    expected = dict(item.split("=", 1) for item in FIELDS[name].split())
    fields = {field.name: field for field in dataclasses.fields(getattr(t, name))}
    assert list(fields) == list(expected)
    for field, default in expected.items():
        if default == "...":
            assert fields[field].default is dataclasses.MISSING
            assert fields[field].default_factory is dataclasses.MISSING
        else:
            factory = fields[field].default_factory
            held = fields[field].default if factory is dataclasses.MISSING else factory()
            assert held == eval(default, {"MISSING": sys.maxsize, "MAX": sys.maxsize})


def test_scenario_files_find_their_imports():
    for module, names in IMPORTS.items():
        for name in names.split():
            assert getattr(importlib.import_module(module), name) is not None


def test_vocabulary_loads_without_heavy_libraries():
    loaded = subprocess.run(
        [sys.executable, "-c", "import sys, smarts.sstudio.types; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert not {"numpy", "shapely", "numba", "scipy", "yaml", "matplotlib"} & set(loaded)


def test_former_names():
    via = t.Via(edge_id="a", lane_index=0, lane_offset=3, required_speed=5)
    assert via == t.Via("a", 0, 3, 5)
    assert via.edge_id == "a"
    assert t.Route(("a", 0, 0), ("c", 0, 1), via=("b",)).edges == ("a", "b", "c")


class TestIdentity:
    def test_actors_of_one_name_and_other_content_are_two(self):
        patient = t.TrafficActor("car", junction_model=t.JunctionModel(impatience=0.5))
        impatient = t.TrafficActor("car", junction_model=t.JunctionModel(impatience=1.0))
        assert len({patient: 0.5, impatient: 0.5}) == 2
        assert patient.id != impatient.id
        assert patient.id.startswith("car-")

    def test_equal_content_is_one_thing(self):
        def make(number):
            actor = t.TrafficActor("car", tau=number)
            route = t.Route(("a", 0, number), ("b", 0, "max"), via=["c"])
            return [
                actor,
                route,
                t.Flow(route, rate=number, actors={actor: number}),
                t.Trip("x", route, depart=number),
                t.Traffic(flows=[t.Flow(route, number)]),
            ]

        for one, other in zip(make(1), make(1.0), strict=True):
            assert one == other
            assert hash(one) == hash(other)
        for one, other in zip(make(1), make(2), strict=True):
            assert one != other


def test_a_trip_has_a_driver_of_its_own_name():
    route = t.Route(("a", 0, 1), ("b", 0, 2))
    assert t.Trip("leader", route).actor == t.TrafficActor("leader")
    truck = t.TrafficActor("heavy", accel=1, vehicle_type="truck")
    assert t.Trip("leader", route, actor=truck).actor == dataclasses.replace(truck, name="leader")
    assert t.Trip("leader", route, vehicle_type="bus", actor=truck).driver.vehicle_type == "bus"


class TestBubbles:
    zone = t.PositionalZone((0, 0), (10, 10))
    agent = t.SocialAgentActor("agent", "zoo:agent-v0")

    @pytest.mark.parametrize(
        ("arguments", "field", "value", "remedy"),
        [
            ({"follow_actor_id": "a"}, "follow_offset", "'a'", "(0, 0)"),
            (
                {"follow_actor_id": "a", "follow_vehicle_id": "b", "follow_offset": (0, 0)},
                "follow_actor_id",
                "'b'",
                "one of the two",
            ),
            ({"keep_alive": True}, "keep_alive", "'agent'", "BoidAgentActor"),
        ],
    )
    def test_contradictions_name_bubble_value_and_remedy(self, arguments, field, value, remedy):
        with raises(ContradictionError, f"{field} of bubble 'left-turn'") as caught:
            t.Bubble(self.zone, self.agent, id="left-turn", **arguments)
        assert isinstance(caught.value, ValueError)
        assert value in caught.value.problem
        assert remedy in caught.value.remedy


def test_groups_of_social_agents_share_no_actor():
    agent, mission = t.SocialAgentActor("agent", "zoo:agent-v0"), t.Mission(t.RandomRoute())
    with raises(ValueError, values=["one", "two", "agent"]):
        t.Scenario(social_agent_missions={"one": ([agent], [mission]), "two": ([agent], [mission])})
