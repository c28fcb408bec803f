"""Bad input: one error that names file, object, value and remedy, and no half-built artefacts."""

import pytest

from smarts.errors import ScenarioError, SmartsError
from smarts.sstudio import sstypes as t
from smarts.sstudio.build import build_scenario
from smarts.sstudio.collecting import collecting
from smarts.sstudio.decoding import decode
from smarts.sstudio.encoding import encode

from . import sources
from .sources import validate

# What gen_scenario is given, the object that the error names, what it says of it.
WRONG = {
    "edge of a flow": (
        'traffic={"x": t.Traffic(flows=[flow(t.Route(("form_west", 0, 1), ("to_east", 0, 1)))])}',
        "traffic['x'].flows[0].route.begin",
        "'form_west'",
    ),
    "lane of a mission": (
        'ego_missions=[t.Mission(south_north), t.Mission(t.Route(("from_west", 0, 1), ("to_east", 2, 1)))]',
        "ego_missions[1].route.end",
        "lane 2",
    ),
    "offset of a mission": (
        'ego_missions=[t.Mission(t.Route(("from_west", 0, 1000), ("to_east", 0, 1)))]',
        "ego_missions[0].route.begin",
        "1000",
    ),
    "named offset": (
        'ego_missions=[t.EndlessMission(("from_west", 0, "end"))]',
        "ego_missions[0].begin",
        "end",
    ),
    "place": (
        'ego_missions=[t.EndlessMission(("from_west", 0))]',
        "ego_missions[0].begin",
        "('from_west', 0)",
    ),
    "unroutable mission": (
        'ego_missions=[t.Mission(t.Route(("to_east", 0, 1), ("from_south", 0, 1)))]',
        "ego_missions[0].route",
        "'from_south'",
    ),
    "open lap": (
        "ego_missions=[t.LapMission(south_north, num_laps=2)]",
        "ego_missions[0].route, which must be closed",
        "'from_south'",
    ),
    "grid behind the lane": (
        "ego_missions=[t.GroupedLapMission(south_north, offset=15, lanes=2, actor_count=3, num_laps=1)]",
        "ego_missions[0], start 2.route.begin",
        "offset -10",
    ),
    "edge of a via": (
        'ego_missions=[t.Mission(south_north, via=(t.Via("to_nroth", 0, 1, 1),))]',
        "ego_missions[0].via[0]",
        "'to_nroth'",
    ),
    "junction of a via": (
        "ego_missions=[t.Mission(south_north, via=("
        't.Via(t.JunctionEdgeIDResolver("to_east", 0, "to_north", 0), 0, 1, 1),))]',
        "ego_missions[0].via[0].road_id",
        "to_east",
    ),
    "edge of a task": (
        'ego_missions=[t.Mission(south_north, task=t.CutIn(complete_on_edge_id="nowhere"))]',
        "ego_missions[0].task.complete_on_edge_id",
        "nowhere",
    ),
    "trap elsewhere": (
        "ego_missions=[t.Mission(south_north,"
        ' entry_tactic=t.TrapEntryTactic(zone=t.MapZone(("from_west", 0, 1), 9)))]',
        "ego_missions[0].entry_tactic.zone.start",
        "from_west",
    ),
    "traffic without a name": ("traffic=t.Traffic(flows=[flow()])", "traffic", "Traffic("),
    "one mission instead of a list": ("ego_missions=t.Mission(south_north)", "ego_missions", "Mission("),
    "lane by name": (
        'ego_missions=[t.EndlessMission(("from_west", "0", 1))]',
        "ego_missions[0].begin",
        "'0'",
    ),
    "list of actors": (
        'traffic={"x": t.Traffic(flows=[flow(actors=[car])])}',
        "traffic['x'].flows[0].actors",
        "TrafficActor(name='car'",
    ),
    "half a lap": (
        "ego_missions=[t.LapMission(south_north, num_laps=1.5)]",
        "ego_missions[0].num_laps",
        "1.5",
    ),
    "size of a zone": (
        "bubbles=[t.Bubble(t.PositionalZone((0, 0), (1,)), agent)]",
        "bubbles[0].zone.size",
        "(1,)",
    ),
    "route on another map": (
        'ego_missions=[t.Mission(t.RandomRoute(map_spec=t.MapSpec("elsewhere")))]',
        "ego_missions[0].route.map_spec",
        "map",
    ),
    "not a mission": ("ego_missions=[south_north]", "ego_missions[0]", "Route("),
    "no actors": (
        'traffic={"x": t.Traffic(flows=[flow(), flow(actors={})])}',
        "traffic['x'].flows[1].actors",
        "actors",
    ),
    "weights of zero": (
        'traffic={"x": t.Traffic(flows=[flow(actors={car: 0})])}',
        "traffic['x'].flows[0].actors",
        "zero",
    ),
    "negative rate": (
        'traffic={"x": t.Traffic(flows=[flow(rate=-600)])}',
        "traffic['x'].flows[0].rate",
        "-600",
    ),
    "end before begin": (
        'traffic={"x": t.Traffic(flows=[flow(begin=20, end=10)])}',
        "traffic['x'].flows[0].end",
        "10 is",
    ),
    "engine": (
        'traffic={"x": t.Traffic(flows=[], engine="SUM")}',
        "traffic['x'].engine",
        "'SUM'",
    ),
    "twin trips": (
        'traffic={"x": t.Traffic(flows=[], trips=[t.Trip("a", west_east), t.Trip("a", south_north)])}',
        "traffic['x'].trips[1].vehicle_name",
        "'a'",
    ),
    "name of a trip": (
        'traffic={"x": t.Traffic(flows=[], trips=[t.Trip("a b", west_east)])}',
        "traffic['x'].trips[0].vehicle_name",
        "a b",
    ),
    "vehicle type": (
        'traffic={"x": t.Traffic(flows=[flow(actors={t.TrafficActor("car", vehicle_type="lorry"): 1})])}',
        "traffic['x'].flows[0].actors['car'].vehicle_type",
        "lorry",
    ),
    "acceleration": (
        'traffic={"x": t.Traffic(flows=[flow(actors={t.TrafficActor("car", accel=0): 1})])}',
        "traffic['x'].flows[0].actors['car'].accel",
        "0 is",
    ),
    "departure speed": (
        'traffic={"x": t.Traffic(flows=[flow(actors={t.TrafficActor("car", depart_speed="maximum"): 1})])}',
        "traffic['x'].flows[0].actors['car'].depart_speed",
        "'maximum'",
    ),
    "lane changing": (
        'traffic={"x": t.Traffic(flows=[flow(actors={t.TrafficActor("car",'
        " lane_changing_model=t.LaneChangingModel(impatient=1)): 1})])}",
        "traffic['x'].flows[0].actors['car'].lane_changing_model",
        "'lcImpatient'",
    ),
    "stop off the route": (
        'traffic={"x": t.Traffic(flows=[flow(stops=[t.Stop("to_north", 0, 50, 5)])])}',
        "traffic['x'].flows[0].stops[0].road_id",
        "to_north",
    ),
    "stop off the lane": (
        'traffic={"x": t.Traffic(flows=[flow(stops=[t.Stop("to_east", 0, 500, 5)])])}',
        "traffic['x'].flows[0].stops[0]",
        "500",
    ),
    "bubble that crosses itself": (
        "bubbles=[t.Bubble(t.ConfigurableZone([(0, 0), (9, 9), (9, 0), (0, 9)]), agent)]",
        "bubbles[0].zone",
        "4.5",
    ),
    "bubble beside the road": (
        'bubbles=[t.Bubble(t.MapZone(("from_west", 1, 5), 10, n_lanes=2), agent)]',
        "bubbles[0].zone",
        "lane 2",
    ),
    "bubble off the map": (
        "bubbles=[t.Bubble(t.PositionalZone((900, 0), (20, 20)), agent)]",
        "bubbles[0].zone",
        "890",
    ),
    "bubble with a limit of 0": (
        "bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)), agent, limit=t.BubbleLimits(0, 3))]",
        "bubbles[0].limit.hijack_limit",
        "0",
    ),
    "bubble with a margin that is no number": (
        'bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)), agent, margin=float("nan"))]',
        "bubbles[0].margin",
        "nan",
    ),
    "unknown engine of a bubble": (
        "bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)),"
        ' t.TrafficEngineActor("x", traffic_provider="SMARTS"))]',
        "bubbles[0].actor.traffic_provider",
        "'SMARTS'",
    ),
    "social agent that a bubble follows": (
        "bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)), agent, follow_offset=(0, 1),"
        ' follow_actor_id="social-agent-all-agnt")],'
        ' social_agent_missions={"all": ([agent], [t.Mission(south_north)])}',
        "bubbles[0].follow_actor_id",
        "'social-agent-all-agnt'",
    ),
    "social agent that a condition looks for": (
        "bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)), agent,"
        ' active_condition=-t.DependeeActorCondition("social-agent-all-agnt"))]',
        "bubbles[0].active_condition.actor_id",
        "'social-agent-all-agnt'",
    ),
    "vehicle type of a condition": (
        "bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)), agent,"
        ' airlock_condition=t.TimeWindowCondition(0, 9) & -t.VehicleTypeCondition("spaceship"))]',
        "bubbles[0].airlock_condition.vehicle_type",
        "'spaceship'",
    ),
    "offset of a bubble that travels": (
        "bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)), agent, follow_offset=(0,),"
        ' follow_vehicle_id="car")]',
        "bubbles[0].follow_offset",
        "(0,)",
    ),
    "twin bubbles": (
        'bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)), agent, id="b") for _ in range(2)]',
        "bubbles[1].id",
        "'b'",
    ),
    "friction": (
        "friction_maps=[t.RoadSurfacePatch(t.PositionalZone((0, 0), (9, 9)), 0, 10, 0)]",
        "friction_maps[0].friction_coefficient",
        "0 is",
    ),
    "boid with a mission": (
        'social_agent_missions={"g": ([t.BoidAgentActor("b", "zoo:b-v0")], [t.Mission(south_north)])}',
        "social_agent_missions['g']",
        "'b'",
    ),
    "missions without actors": (
        'social_agent_missions={"g": [t.Mission(south_north)]}',
        "social_agent_missions['g']",
        "Mission(",
    ),
    "social agents without actors": (
        'social_agent_missions={"g": ([], [t.Mission(south_north)])}',
        "social_agent_missions['g']",
        "no actors",
    ),
    "truth as a condition": (
        "bubbles=[t.Bubble(t.PositionalZone((0, 0), (9, 9)), agent, active_condition=True)]",
        "bubbles[0].active_condition",
        "True",
    ),
    "mission of an agent": (
        'social_agent_missions={"g": ([agent], [t.EndlessMission(("x", 0, 1))])}',
        "social_agent_missions['g'].missions[0].begin",
        "'x'",
    ),
    "source of a data set": (
        'traffic_histories=[t.TrafficHistoryDataset("a", "NGSMI")]',
        "traffic_histories[0].source_type",
        "'NGSMI'",
    ),
    "map builder": (
        'map_spec=t.MapSpec(".", builder_fn=print)',
        "map_spec.builder_fn",
        "functions",
    ),
    "map as a number": ("map_spec=t.MapSpec(5)", "map_spec.source", "int: 5"),
    "map of a variation": (
        'held_out={"v": t.Variation("Other.", map_spec=".")}',
        "held_out['v'].map_spec",
        "'.'",
    ),
    "missing map": ('map_spec=t.MapSpec("elsewhere")', "", "'elsewhere'"),
    "what cannot be written down": (
        'social_agent_missions={"g": ([t.SocialAgentActor("a", "z:a-v0", {"f": lambda: 0})], [])}',
        "social_agent_missions['g'][0][0].policy_kwargs['f']",
        "lambda",
    ),
}

NEAREST = {
    "edge of a flow": "'from_west'",
    "edge of a via": "'to_north'",
    "engine": "'SUMO'",
    "departure speed": "'max'",
    "lane changing": "'lcImpatience'",
    "source of a data set": "'NGSIM'",
}
"""Names that the remedies of cases suggest."""

BEFORE_VALIDATION = (
    *("traffic without a name", "map as a number", "map of a variation", "missing map"),
    "what cannot be written down",
)
"""Cases that the build notices before it has a map."""


def refusal(folder) -> SmartsError:
    with pytest.raises(SmartsError) as caught:
        build_scenario(folder)
    return caught.value


def artefacts(folder):
    return [entry.name for entry in (folder / "build").glob("*") if entry.name not in ("index", ".lock")]


@pytest.mark.parametrize("case", [case for case in WRONG if case not in BEFORE_VALIDATION])
def test_refused(case, roads):
    body, place, value = WRONG[case]
    with collecting() as collection:
        exec(sources.scenario(body), {"__file__": "scenario.py"})
    with pytest.raises(ScenarioError) as caught:
        validate(decode(encode(collection.scenario)), roads, "scenario.py")
    assert caught.value.place.startswith(f"scenario.py: {place}")
    if place.startswith("bubbles[0]"):
        assert caught.value.place.endswith(f" of bubble {collection.scenario.bubbles[0].id!r}")
    assert value in caught.value.problem
    assert caught.value.remedy
    assert NEAREST.get(case, "") in caught.value.remedy


@pytest.mark.parametrize("case", [*BEFORE_VALIDATION, "edge of a flow"])
def test_refused_by_the_build(case, scenario_folder):
    body, place, value = WRONG[case]
    folder = scenario_folder(sources.scenario(body))
    error = refusal(folder)
    assert error.exit_code == 2
    assert str(folder) in error.place
    assert place in error.place
    assert value in error.problem
    assert error.remedy
    assert not artefacts(folder)


@pytest.mark.parametrize(
    ("script", "place", "value"),
    [
        ("x = 1\n\n1 / 0\n", "scenario.py, line 3", "ZeroDivisionError"),
        ("def f(:\n", "scenario.py, line 1", "SyntaxError"),
        ("import os\nos._exit(3)\n", "scenario.py", "code 3"),
        (
            sources.SCRIPT + sources.SCRIPT.partition("car =")[2].partition("\n")[2],
            "scenario.py, line 17",
            "second scenario",
        ),
        (
            "from smarts.sstudio import types as t\nt.Traffic(flows=[])\n",
            "scenario.py",
            "no scenario",
        ),
        (
            "from smarts.sstudio import types as t\nt.BubbleLimits(2, 1)\n",
            "scenario.py, line 2, BubbleLimits.shadow_limit",
            "1 is below",
        ),
    ],
)
def test_scenario_files_that_fail(scenario_folder, script, place, value):
    folder = scenario_folder(script)
    error = refusal(folder)
    assert place in error.place
    assert value in error.problem
    assert not artefacts(folder)


def test_the_line_is_that_of_the_scenarios_own_helper(scenario_folder):
    folder = scenario_folder("import helper\nhelper.fail()\n", helper="def fail():\n    [][1]\n")
    assert "helper.py, line 2" in refusal(folder).place


def test_variations_are_checked_as_the_scenario_is(scenario_folder):
    body = 'held_out={"v": t.Variation("Off.", ego_missions=[t.EndlessMission(("x", 0, 1))])}'
    folder = scenario_folder(sources.scenario(body))
    assert build_scenario(folder).held_out == ("v",)
    error = refusal(f"{folder}@v")
    assert "held_out['v']: ego_missions[0].begin" in error.place
    error = refusal(f"{folder}@w")
    assert str(error).endswith("there is no held-out variation 'w'\n  remedy: known: 'v'")


def test_bubbles_that_travel_may_begin_beside_the_map(roads):
    agent, zone = t.SocialAgentActor("agent", "zoo:agent-v0"), t.PositionalZone((5000, 0), (9, 9))
    travelling = t.Bubble(zone, agent, follow_vehicle_id="any", follow_offset=(0, 9))
    validate(t.Scenario(bubbles=[travelling]), roads, "scenario.py")


def test_names_that_mean_nothing(tmp_path):
    assert "there is no scenario.py and no map" in str(refusal(tmp_path))
    assert "did you mean 'intersection'" in refusal("intersektion").remedy
    (tmp_path / "merge").mkdir()
    assert str(tmp_path / "merge") in refusal(f"{tmp_path}/marge").remedy


def test_broken_maps_bring_netconverts_own_message(scenario_folder):
    folder = scenario_folder()
    (folder / "map.edg.xml").write_text('<edges><edge id="a" from="west" to="nowhere"/></edges>')
    assert "nowhere" in str(refusal(folder))
    assert not artefacts(folder)
