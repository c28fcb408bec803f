"""The vocabulary: names, order and defaults that scenario files rely on, and what makes two things one."""

import dataclasses
import importlib
import os
import subprocess
import sys

import numpy as np
import pytest

from smarts.errors import ContradictionError
from smarts.sstudio import types as t
from smarts.sstudio.sstypes.drawing import fresh_drawing
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
    "additional_files=() sumo_options={}",
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
        "source=... lanepoint_spacing=1.0 default_lane_width=None shift_to_origin=False builder_fn=None"
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
IMPORTS = [
    "smarts.core.colors:Colors",
    "smarts.sstudio.genscenario:gen_agent_missions",
    "smarts.sstudio.genscenario:gen_scenario",
    "smarts.sstudio.genscenario:gen_social_agent_missions",
    "smarts.sstudio.genscenario:gen_traffic",
    "smarts.sstudio.sstypes.entry_tactic:IdEntryTactic",
    "smarts.sstudio.sstypes.route:RandomRoute",
    "smarts.sstudio.sstypes.traffic:Trip",
    "smarts.sstudio.sstypes:SocialAgentActor",
    "smarts.sstudio.types.entry_tactic:IdEntryTactic",
    "smarts.sstudio.types.route:RandomRoute",
    "smarts.sstudio.types.traffic:Trip",
    "smarts.sstudio:gen_bubbles",
    "smarts.sstudio:gen_friction_map",
    "smarts.sstudio:gen_group_laps",
    "smarts.sstudio:gen_missions",
    "smarts.sstudio:gen_scenario",
    "smarts.sstudio:gen_social_agent_missions",
    "smarts.sstudio:gen_traffic",
    "smarts.sstudio:types",
]
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


def test_a_traffic_actor_is_a_car():
    car = t.TrafficActor("car")
    assert (car.accel, car.decel, car.tau, car.sigma, car.emergency_decel) == (2.6, 4.5, 1.0, 0.5, 4.5)
    assert (car.depart_speed, car.max_speed, car.vehicle_type) == ("max", 55.5, "passenger")
    assert car.speed == t.Distribution(mean=1.0, sigma=0.1)
    assert car.imperfection == t.Distribution(0.5, 0)
    assert car.min_gap == t.Distribution(2.5, 0)


def test_scenario_files_find_their_imports():
    for path in IMPORTS:
        module, _, name = path.partition(":")
        assert getattr(importlib.import_module(module), name) is not None


def test_there_is_one_class_by_all_paths():
    from smarts.sstudio import sstypes
    from smarts.sstudio.types.route import Route

    assert Route is t.Route is sstypes.Route


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
    with pytest.raises(TypeError, match="former name"):
        t.Via(edge_id="a", road_id="a", lane_index=0, lane_offset=3, required_speed=5)


def test_entry_tactics_of_both_generations():
    new = t.TrapEntryTactic(12, wait_to_hijack_limit_s=1, default_entry_speed=3)
    assert (new.start_time, new.wait_to_hijack_limit_s) == (12, 1)
    old = t.TrapEntryTactic(wait_to_hijack_limit_s=3, zone=t.MapZone(("a", 0, 1), 10, 1))
    assert old.start_time == t.MISSING
    assert t.IdEntryTactic(actor_id="leader").actor_id == "leader"
    with pytest.raises(ValueError, match="actor_id"):
        t.IdEntryTactic(0.1)


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

    def test_types_are_told_apart(self):
        assert t.LaneChangingModel() != t.JunctionModel()
        assert t.Distribution(0, 1) != t.UniformDistribution(0, 1)
        assert t.LaneChangingModel(impatience=1) != {"lcImpatience": 1}

    def test_ids_do_not_depend_on_the_process(self):
        program = (
            "from smarts.sstudio import types as t\n"
            "car = t.TrafficActor('car'); route = t.Route(('a', 0, 1), ('b', 0, 2))\n"
            "flow = t.Flow(route, 10, actors={car: 1, t.TrafficActor('van'): 2})\n"
            "print(car.id, route.id, flow.id, hash(car), hash(flow))"
        )
        outputs = {
            subprocess.run(
                [sys.executable, "-c", program],
                env=os.environ | {"PYTHONHASHSEED": seed},
                capture_output=True,
                text=True,
                check=True,
            ).stdout
            for seed in ("1", "2")
        }
        assert len(outputs) == 1

    def test_the_order_of_actors_does_not_matter(self):
        route, car, van = t.Route(("a", 0, 1), ("b", 0, 2)), t.TrafficActor("car"), t.TrafficActor("van")
        assert t.Flow(route, 1, actors={car: 1, van: 2}) == t.Flow(route, 1, actors={van: 2, car: 1})

    def test_random_routes_are_different_ones(self):
        assert t.RandomRoute() != t.RandomRoute()
        assert t.RandomRoute("x") == t.RandomRoute("x")


def test_unnamed_things_are_numbered_afresh_in_every_run():
    def run():
        with fresh_drawing(7):
            agent = t.SocialAgentActor("a", "zoo:a-v0")
            bubbles = [t.Bubble(t.PositionalZone((0, 0), (1, 1)), agent) for _ in range(2)]
            return [bubble.id for bubble in bubbles], t.RandomRoute().id, t.Distribution(0, 1).sample()

    first, second = run(), run()
    assert first == second
    assert first[:2] == (["bubble-1", "bubble-2"], "random-route-1")


def test_distributions_draw_from_the_generator_they_are_given():
    from smarts.types.streams import Purpose, stream

    generator = stream(1, Purpose.BUILD)
    assert t.Distribution(5, 0).sample(generator) == 5
    uniform = t.UniformDistribution(3, 1)
    assert (uniform.a, uniform.b) == (1, 3)
    drawn = [uniform.sample(generator) for _ in range(2000)]
    assert 1 <= min(drawn) < 1.1 < 2.9 < max(drawn) <= 3
    cut = t.TruncatedDistribution(-1, 2, loc=10, scale=2)
    drawn = [cut.sample(generator) for _ in range(2000)]
    assert 8 <= min(drawn) < 8.1
    assert 13.5 < max(drawn) <= 14
    # The mean of a normal distribution cut to [-1, 2] deviations is (pdf(-1) - pdf(2)) / (cdf(2) - cdf(-1)).
    assert sum(drawn) / len(drawn) == pytest.approx(10 + 2 * 0.2297, abs=0.1)


@pytest.mark.parametrize("sign", [1, -1])
def test_far_tails_lie_near_their_likelier_end(sign):
    tail = t.TruncatedDistribution(9 * sign, 12 * sign)
    assert tail.mean == pytest.approx(9 * sign, rel=0.02)
    drawn = [tail.sample(np.random.Generator(np.random.Philox(seed))) for seed in range(20)]
    assert drawn == pytest.approx([9 * sign] * 20, rel=0.1)


def test_models_show_the_engines_names():
    model = t.LaneChangingModel(impatience=1, speed_gain=2, minGapLat=0.5)
    assert dict(model) == {"lcImpatience": 1, "lcSpeedGain": 2, "minGapLat": 0.5}
    junction = t.JunctionModel(drive_after_red_time=1.5, impatience=1.0)
    assert dict(junction) == {"jmDriveAfterRedTime": 1.5, "impatience": 1.0}
    assert t.SmartsLaneChangingModel(cutin_prob=1)["lcCutinProb"] == 1
    assert t.SmartsJunctionModel("never")["jmYieldToAgents"] == "never"


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
            (
                {"active_condition": t.VehicleSpeedCondition(0, 1)},
                "active_condition",
                "VehicleSpeedCondition",
                "airlock_condition",
            ),
        ],
    )
    def test_contradictions_name_bubble_value_and_remedy(self, arguments, field, value, remedy):
        with raises(ContradictionError, f"{field} of bubble 'left-turn'") as caught:
            t.Bubble(self.zone, self.agent, id="left-turn", **arguments)
        assert isinstance(caught.value, ValueError)
        assert value in caught.value.problem
        assert remedy in caught.value.remedy

    def test_who_drives(self):
        assert not t.Bubble(self.zone, self.agent).is_boid
        assert t.Bubble(self.zone, t.BoidAgentActor("b", "zoo:b-v0"), keep_alive=True).is_boid
        engine = t.Bubble(self.zone, t.TrafficEngineActor("car"))
        assert (engine.is_boid, engine.traffic_provider) == (True, "LocalTrafficProvider")

    def test_agents_of_groups(self):
        assert t.Bubble.to_actor_id(self.agent, mission_group="all") == "social-agent-all-agent"
        assert t.Bubble.to_actor_id(self.agent, mission_group=None) == "social-agent-agent"


def test_metadata():
    fields = t.ScenarioMetadataFields
    metadata = t.ScenarioMetadata({"author": "me", fields.scenario_duration: 30}, scenario_difficulty=0.5)
    assert dict(metadata) == {"author": "me", "scenario_duration": 30, "scenario_difficulty": 0.5}
    assert metadata[fields.scenario_difficulty] == 0.5
    assert metadata.get(fields.actor_of_interest_color, "none") == "none"
    assert metadata.get("author") == "me"


def test_groups_of_social_agents_share_no_actor():
    agent, mission = t.SocialAgentActor("agent", "zoo:agent-v0"), t.Mission(t.RandomRoute())
    with raises(ValueError, values=["one", "two", "agent"]):
        t.Scenario(social_agent_missions={"one": ([agent], [mission]), "two": ([agent], [mission])})


def test_start_variations_are_checked():
    for wrong in ({"offset": -1}, {"speed": (2, 1)}):
        with pytest.raises(ValueError, match="must"):
            t.StartVariation(**wrong)
