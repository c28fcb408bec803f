"""Bad input: one error that names file, object, value and remedy, and no half-built artefacts."""

import pytest

from smarts.errors import ScenarioError, SmartsError
from smarts.sstudio import sstypes as t
from smarts.sstudio.build import build_scenario
from tests.raising import raises

from . import sources
from .sources import validate

CAR = t.TrafficActor("car")
WEST_EAST = t.Route(("from_west", 0, 10), ("to_east", 0, "max"))
SOUTH_NORTH = t.Route(("from_south", 0, 20), ("to_north", 0, 50))
AGENT = t.SocialAgentActor("agent", "zoo:agent-v0")
ZONE = t.PositionalZone((0, 0), (9, 9))


def traffic(*flows, **more):
    return t.Scenario(traffic={"x": t.Traffic(flows, **more)})


def flow(route=WEST_EAST, **changes):
    return traffic(t.Flow(**({"route": route, "rate": 60, "actors": {CAR: 1}} | changes)))


def actor(**changes):
    return flow(actors={t.TrafficActor("car", **changes): 1})


def mission(route=SOUTH_NORTH, **changes):
    return t.Scenario(ego_missions=[t.Mission(route, **changes)])


def endless(*place):
    return t.Scenario(ego_missions=[t.EndlessMission(place)])


def bubble(zone=ZONE, by=AGENT, **changes):
    return t.Scenario(bubbles=[t.Bubble(zone, by, **changes)])


def social(*group):
    return t.Scenario(social_agent_missions={"g": group})


FLOW, MISSION = "traffic['x'].flows[0]", "ego_missions[0]"
ACTOR = f"{FLOW}.actors['car']"
AGNT = "social-agent-all-agnt"
WRONG = [
    (
        flow(t.Route(("form_west", 0, 1), ("to_east", 0, 1))),
        f"{FLOW}.route.begin",
        "did you mean 'from_west'",
    ),
    (flow(rate=-600), f"{FLOW}.rate", "-600"),
    (flow(begin=20, end=10), f"{FLOW}.end", "10 is"),
    (flow(actors={}), f"{FLOW}.actors", "no actors"),
    (flow(actors=[CAR]), f"{FLOW}.actors", "use a dict"),
    (flow(stops=[t.Stop("to_north", 0, 50, 5)]), f"{FLOW}.stops[0].road_id", "to_north"),
    (flow(stops=[t.Stop("to_east", 0, at, 5) for at in (60, 30)]), f"{FLOW}.stops[1]", "30"),
    (flow(t.RandomRoute(), stops=[t.Stop("to_east", 0, 5, 5)]), f"{FLOW}.stops", "random"),
    (traffic(engine="SUM"), "traffic['x'].engine", "did you mean 'SUMO'"),
    (traffic(trips=[t.Trip("a", WEST_EAST)] * 2), "traffic['x'].trips[1].vehicle_name", "'a'"),
    (actor(vehicle_type="lorry"), f"{ACTOR}.vehicle_type", "lorry"),
    (actor(accel=0), f"{ACTOR}.accel", "0 is"),
    (actor(sigma=7), f"{ACTOR}.sigma", "0 to 1"),
    (actor(depart_speed="maximum"), f"{ACTOR}.depart_speed", "did you mean 'max'"),
    (actor(speed=1.2), f"{ACTOR}.speed", "use a Distribution"),
    (
        actor(lane_changing_model=t.LaneChangingModel(impatient=1)),
        f"{ACTOR}.lane_changing_model",
        "'lcImpatience'",
    ),
    (t.Scenario(ego_missions=t.Mission(SOUTH_NORTH)), "ego_missions", "not a list: Mission("),
    (t.Scenario(ego_missions=[SOUTH_NORTH]), MISSION, "Route("),
    (mission(t.Route(("from_west", 0, 1), ("to_east", 2, 1))), f"{MISSION}.route.end", "lane 2"),
    (mission(t.Route(("from_west", 0, 1000), ("to_east", 0, 1))), f"{MISSION}.route.begin", "1000"),
    (mission(t.Route(("to_east", 0, 1), ("from_south", 0, 1))), f"{MISSION}.route", "'from_south'"),
    (mission(t.Route(("from_west", 0, 50), ("from_west", 0, 10))), f"{MISSION}.route", "40"),
    (mission(via=[t.Via("to_nroth", 0, 1, 1)]), f"{MISSION}.via[0]", "did you mean 'to_north'"),
    (mission(via=[t.Via("to_south", 0, 10, 5)]), f"{MISSION}.via[0].road_id", "to_south_0"),
    (mission(task=t.CutIn(complete_on_edge_id="nowhere")), f"{MISSION}.task.complete_on_edge_id", "nowhere"),
    (mission(task=t.UTurn()), f"{MISSION}.task", "to_north"),
    (
        mission(entry_tactic=t.TrapEntryTactic(zone=t.MapZone(("from_west", 0, 1), 9))),
        f"{MISSION}.entry_tactic.zone.start",
        "from_west",
    ),
    (mission(start_time="5"), f"{MISSION}.start_time", "'5' is"),
    (t.Scenario(ego_missions=[t.LapMission(SOUTH_NORTH, 0)]), f"{MISSION}.num_laps", "0 is"),
    (t.Scenario(start_variation={"offset": 5}), "start_variation", "use a StartVariation"),
    (endless("from_west", 0, "end"), f"{MISSION}.begin", "end"),
    (endless("from_west", 0), f"{MISSION}.begin", "('from_west', 0)"),
    (endless(":centre_0", 0, 0.1), f"{MISSION}.begin", "junction"),
    (
        t.Scenario(ego_missions=[t.LapMission(SOUTH_NORTH, 2)]),
        f"{MISSION}.route, which must be closed",
        "'from_south'",
    ),
    (
        t.Scenario(ego_missions=[t.GroupedLapMission(SOUTH_NORTH, 15, 2, 3, 1)]),
        f"{MISSION}, start 2.route.begin",
        "offset -10",
    ),
    (bubble(t.ConfigurableZone([(0, 0), (9, 9), (9, 0), (0, 9)])), "bubbles[0].zone", "4.5"),
    (bubble(t.PositionalZone((900, 0), (20, 20))), "bubbles[0].zone", "890"),
    (bubble(limit=2), "bubbles[0].limit", "use a BubbleLimits"),
    (bubble(limit=t.BubbleLimits(0, 2)), "bubbles[0].limit.hijack_limit", "0 is"),
    (bubble(active_condition=True), "bubbles[0].active_condition", "use a Condition"),
    (bubble(active_condition=t.VehicleSpeedCondition(0, 1)), "bubbles[0].active_condition", "actor_state"),
    (
        bubble(by=t.TrafficEngineActor("x", traffic_provider="SMARTS")),
        "bubbles[0].actor.traffic_provider",
        "'SMARTS'",
    ),
    (bubble(follow_actor_id=AGNT, follow_offset=(0, 1)), "bubbles[0].follow_actor_id", AGNT),
    (bubble(active_condition=-t.DependeeActorCondition(AGNT)), "bubbles[0].active_condition.actor_id", AGNT),
    (
        bubble(airlock_condition=-t.VehicleTypeCondition("spaceship")),
        "bubbles[0].airlock_condition.vehicle_type",
        "'spaceship'",
    ),
    (
        t.Scenario(friction_maps=[t.RoadSurfacePatch(ZONE, 0, 10, 0)]),
        "friction_maps[0].friction_coefficient",
        "0 is",
    ),
    (social(t.Mission(SOUTH_NORTH)), "social_agent_missions['g']", "Mission("),
    (social([], [t.Mission(SOUTH_NORTH)]), "social_agent_missions['g']", "no actors"),
    (t.Scenario(map_spec=t.MapSpec(".", builder_fn=print)), "map_spec.builder_fn", "functions"),
]


@pytest.mark.parametrize(("scenario", "place", "value"), WRONG, ids=[place for _, place, _ in WRONG])
def test_refused(scenario, place, value, roads):
    with raises(ScenarioError, values=[f"scenario.py: {place}", value, "remedy"]):
        validate(scenario, roads, "scenario.py")


def refusal(folder) -> SmartsError:
    with pytest.raises(SmartsError) as caught:
        build_scenario(folder)
    return caught.value


def artefacts(folder):
    return [entry.name for entry in (folder / "build").glob("*") if entry.name not in ("index", ".lock")]


@pytest.mark.parametrize(
    ("body", "place", "value"),
    [
        ("traffic=t.Traffic(flows=[flow()])", "traffic", "Traffic("),
        ('ego_missions=[t.EndlessMission(("form_west", 0, 1))]', "ego_missions[0].begin", "'form_west'"),
        ('map_spec=t.MapSpec("elsewhere")', "", "'elsewhere'"),
        ('map_spec="elsewhere"', "map_spec", "not a MapSpec"),
        ('held_out=[t.Variation("Off.")]', "held_out", "not a dict by name"),
        (
            'social_agent_missions={"g": ([t.SocialAgentActor("a", "z:a-v0", {"f": lambda: 0})], [])}',
            "social_agent_missions['g'][0][0].policy_kwargs['f']",
            "lambda",
        ),
    ],
)
def test_refused_by_the_build(body, place, value, scenario_folder):
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
        (f"{sources.SCRIPT}gen_scenario(t.Scenario(), '.')\n", "scenario.py, line", "second scenario"),
        ("from smarts.sstudio import types as t\nt.Traffic(flows=[])\n", "scenario.py", "no scenario"),
    ],
)
def test_scenario_files_that_fail(scenario_folder, script, place, value):
    folder = scenario_folder(script)
    error = refusal(folder)
    assert place in error.place
    assert value in error.problem
    assert not artefacts(folder)


def test_variations_are_checked_as_the_scenario_is(scenario_folder):
    body = 'held_out={"v": t.Variation("Off.", ego_missions=[t.EndlessMission(("x", 0, 1))])}'
    folder = scenario_folder(sources.scenario(body))
    assert build_scenario(folder).held_out == ("v",)
    assert "held_out['v']: ego_missions[0].begin" in refusal(f"{folder}@v").place
    assert str(refusal(f"{folder}@w")).endswith("there is no held-out variation 'w'\n  remedy: known: 'v'")


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


def test_what_is_right_is_taken(roads):
    inside = t.JunctionEdgeIDResolver("from_west", 0, "to_east", 0)
    vias = [t.Via("from_west", 0, 20, 5), t.Via(inside, 0, 2, 5), t.Via("to_east", 0, 2, 5)]
    tactic = t.TrapEntryTactic(default_entry_speed=0, exclusion_prefixes=["car"])
    validate(mission(WEST_EAST, via=vias, entry_tactic=tactic), roads, "")
    validate(mission(t.Route(WEST_EAST.begin, ("to_west", 0, 60)), task=t.UTurn(60, 0, 9)), roads, "")
    validate(social(AGENT, [t.Mission(t.RandomRoute())]), roads, "")
    validate(
        bubble(t.PositionalZone((5000, 0), (9, 9)), follow_vehicle_id="any", follow_offset=(0, 9)), roads, ""
    )
    models = {"junction_model": t.JunctionModel(impatience="off", timegap_minor=-0.5), "depart_speed": 20}
    validate(actor(**models), roads, "")


def test_vias_and_stops_of_rounds_may_be_on_the_way_back(ring):
    route, via = t.Route(("south", 0, 10), ("east", 0, 30)), [t.Via("north", 0, 10, 5)]
    validate(t.Scenario(ego_missions=[t.LapMission(route, 2, via=via)]), ring, "")
    stop = t.Stop("east", 0, 60, 5)
    validate(flow(route, stops=[stop], repeat_route=True), ring, "")
    with raises(ScenarioError, ".stops[0]", values=[60]):
        validate(flow(route, stops=[stop]), ring, "")


def test_missions_and_stops_keep_off_sidewalks(fork):
    with raises(ScenarioError, f"{MISSION}.route.begin", values=["'ab_0'", "open: 1, 2"]):
        validate(mission(t.Route(("ab", 0, 20), ("bc", 0, 20))), fork, "")
    with raises(ScenarioError, ".stops[0]", values=["'ab_0'"]):
        validate(flow(t.Route(("ab", 1, 5), ("bc", 0, 50)), stops=[t.Stop("ab", 0, 50, 5)]), fork, "")
