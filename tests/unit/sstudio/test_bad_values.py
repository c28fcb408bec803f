"""Values that SUMO would choke on in mid-episode are refused when the scenario is built."""

import dataclasses
import math
import subprocess
from pathlib import Path

import pytest
import sumo

from smarts.errors import ScenarioError
from smarts.roads.lane_graph import LaneKind
from smarts.sstudio import types as t
from smarts.sstudio.decoding import decode
from smarts.sstudio.encoding import encode
from smarts.sstudio.vehicle_types import JUNCTIONS, LANE_CHANGING
from tests.raising import raises

from .sources import validate

CAR = t.TrafficActor("car")
WEST_EAST = t.Route(("from_west", 0, 10), ("to_east", 0, "max"))
AGENT = t.SocialAgentActor("agent", "zoo:agent-v0")


def flow(**changes):
    return flows(t.Flow(**({"route": WEST_EAST, "rate": 60, "actors": {CAR: 1}} | changes)))


def flows(*given):
    return t.Scenario(traffic={"x": t.Traffic(given)})


def actor(**changes):
    return flow(actors={t.TrafficActor("car", **changes): 1})


def lanes(**attributes):
    return actor(lane_changing_model=t.LaneChangingModel(**attributes))


def junctions(**attributes):
    return actor(junction_model=t.JunctionModel(**attributes))


def halting(*offsets):
    return flow(stops=[t.Stop("to_east", 0, offset, 5) for offset in offsets])


def traffic(**changes):
    return t.Scenario(traffic={"x": t.Traffic(**({"flows": []} | changes))})


def bubble(zone):
    return t.Scenario(bubbles=[t.Bubble(zone, AGENT)])


def mission(begin=("from_west", 0, 10), end=("to_east", 0, 50), **changes):
    return t.Scenario(ego_missions=[t.Mission(t.Route(begin, end), **changes)])


def turn(end=("to_west", 0, 60), **changes):
    return mission(end=end, task=t.UTurn(**changes))


def trap(**changes):
    return mission(entry_tactic=t.TrapEntryTactic(**changes))


FLOW = "traffic['x'].flows[0]"
ACTOR = f"{FLOW}.actors['car']"
TRIP_NAME = "traffic['x'].trips[0].vehicle_name"
LANES, JUNCTION = f"{ACTOR}.lane_changing_model", f"{ACTOR}.junction_model"
BACK = t.Route(("from_west", 0, 50), ("from_west", 0, 10))

TASK, TACTIC, VIA = (f"ego_missions[0].{part}" for part in ("task", "entry_tactic", "via[0]"))
SPEEDS = (math.nan, -3, 1e9, "5")
BAD = {
    **{f"turn at {v}": (turn(initial_speed=v), f"{TASK}.initial_speed", "100") for v in SPEEDS},
    **{
        f"entry at {v}": (trap(default_entry_speed=v), f"{TACTIC}.default_entry_speed", "100") for v in SPEEDS
    },
    "start speeds of rockets": (
        t.Scenario(start_variation=t.StartVariation(speed=(900, 1000))),
        "start_variation.speed",
        "900",
    ),
    "starts anywhere": (
        t.Scenario(start_variation=t.StartVariation(offset=1e6)),
        "start_variation.offset",
        "1000",
    ),
    "prefixes as text": (trap(exclusion_prefixes="car"), f"{TACTIC}.exclusion_prefixes", "car"),
    "prefix as number": (trap(exclusion_prefixes=[3]), f"{TACTIC}.exclusion_prefixes[0]", "3"),
    "via off the route": (
        mission(via=[t.Via("to_south", 0, 10, 5)]),
        f"{VIA}.road_id",
        "to_south_0",
    ),
    "via in another turn": (
        mission(via=[t.Via(t.JunctionEdgeIDResolver("from_west", 0, "to_south", 0), 0, 2, 5)]),
        f"{VIA}.road_id",
        "",
    ),
    "via of a rocket": (mission(via=[t.Via("to_east", 0, 10, 1e9)]), f"{VIA}.required_speed", "100"),
    "via hit nowhere": (
        mission(via=[t.Via("to_east", 0, 10, 5, hit_distance=math.nan)]),
        f"{VIA}.hit_distance",
        "nan",
    ),
    "turn across": (
        turn(end=("to_south", 0, 60)),
        TASK,
        "to_south",
    ),
    "turn far ahead": (turn(end=("from_east", 0, 60)), TASK, ""),
    "turn into a negative lane": (
        turn(target_lane_index=-9),
        f"{TASK}.target_lane_index",
        "-9",
    ),
    "turn into half a lane": (
        turn(target_lane_index=0.5),
        f"{TASK}.target_lane_index",
        "0.5",
    ),
    "actor without a name": (flow(actors={t.TrafficActor(None): 1}), f"{FLOW}.actors key.name", "NoneType"),
    "long name of an actor": (flow(actors={t.TrafficActor("x" * 300): 1}), FLOW, ""),
    "long name of traffic": (t.Scenario(traffic={"x" * 300: t.Traffic([])}), "traffic", ""),
    "name of many bytes": (t.Scenario(traffic={"ü" * 90: t.Traffic([])}), "traffic", ""),
    "huge rate": (flow(rate=1e12), f"{FLOW}.rate", "36000"),
    "truth as rate": (flow(rate=True), f"{FLOW}.rate", "True"),
    "huge end": (flow(end=1e12), f"{FLOW}.end", "1e+09"),
    "huge weight": (flow(actors={CAR: 1e300}), f"{FLOW}.actors['car']", "1e+09"),
    "via as text": (
        flow(route=t.Route(*("from_west", "to_east"), via="to_east")),
        f"{FLOW}.route.via",
        "to_east",
    ),
    "huge warm-up": (traffic(warm_up=1e12), "traffic['x'].warm_up", "3600"),
    "a flow for flows": (traffic(flows=flow()), "traffic['x'].flows", ""),
    "no headway": (actor(tau=0), f"{ACTOR}.tau", "0"),
    "sigma": (actor(sigma=7), f"{ACTOR}.sigma", "7"),
    "asleep": (actor(reaction_time=11), f"{ACTOR}.reaction_time", "11"),
    "reacts before": (actor(reaction_time=-1), f"{ACTOR}.reaction_time", "-1"),
    "infinite": (actor(accel=math.inf), f"{ACTOR}.accel", "inf"),
    "uniform": (actor(min_gap=t.UniformDistribution(0, math.nan)), f"{ACTOR}.min_gap.", "nan"),
    "truncated": (actor(speed=t.TruncatedDistribution(-1, 1, 1, -2)), f"{ACTOR}.speed.scale", "-2"),
    "lane changing: text": (lanes(cooperative="very"), LANES, "very"),
    "lane changing: nan": (lanes(cooperative=math.nan), LANES, "nan"),
    "lane changing: truth": (lanes(keep_right=True), LANES, "True"),
    "lane changing: range": (lanes(assertive=-1), LANES, "-1"),
    "junctions: text": (junctions(impatience="x"), JUNCTION, "x"),
    "junctions: range": (junctions(drive_after_red_time=-3), JUNCTION, "-1"),
    "junctions: dict": (actor(junction_model={"impatience": 1}), JUNCTION, "impatience"),
    "backwards": (t.Scenario(ego_missions=[t.Mission(BACK)]), "ego_missions[0].route", "40"),
    "start variation": (t.Scenario(start_variation=5), "start_variation", "5"),
    "start speeds": (
        t.Scenario(start_variation=t.StartVariation(speed=(0, math.nan))),
        "start_variation.speed",
        "nan",
    ),
    "nowhere": (bubble(t.PositionalZone((math.nan, 0), (1, 1))), "bubbles[0].zone.pos", "nan"),
    "corner": (
        bubble(t.ConfigurableZone([(0, 0), (1, math.inf), (2, 3)])),
        "bubbles[0].zone.ext_coordinates[1]",
        "inf",
    ),
    "rotation": (bubble(t.PositionalZone((0, 0), (1, 1), "x")), "bubbles[0].zone.rotation", "x"),
    "via by the name of its offset": (
        mission(via=[t.Via("from_west", 0, "max", 5)]),
        f"{VIA}.lane_offset",
        "'max'",
    ),
    "via in a junction by the name of its offset": (
        mission(via=[t.Via(t.JunctionEdgeIDResolver("from_west", 0, "to_east", 0), 0, "max", 5)]),
        f"{VIA}.lane_offset",
        "'max'",
    ),
    "end behind a named begin": (
        mission(("to_east", 0, "max"), ("to_east", 0, 10)),
        "ego_missions[0].route",
        "m before",
    ),
    "end within the vehicle at its start": (
        mission(("to_east", 0, 0), ("to_east", 0, 3)),
        "ego_missions[0].route",
        "2 m before",
    ),
    "begin inside a junction": (
        t.Scenario(ego_missions=[t.EndlessMission((":centre_0", 0, 0.1))]),
        "ego_missions[0].begin",
        "junction",
    ),
    "laps on a dead end": (
        t.Scenario(ego_missions=[t.LapMission(t.Route(("to_east", 0, 10), ("to_east", 0, 50)), 2)]),
        "ego_missions[0].route, which must be closed",
        "'to_east'",
    ),
    "entry under no condition": (
        mission(entry_tactic=t.IdEntryTactic(actor_id="car", condition="x")),
        f"{TACTIC}.condition",
        "'x'",
    ),
    "trap under no condition": (trap(condition="x"), f"{TACTIC}.condition", "'x'"),
    "entry under a condition on a vehicle": (
        mission(entry_tactic=t.IdEntryTactic(actor_id="car", condition=t.VehicleSpeedCondition(0, 9))),
        f"{TACTIC}.condition",
        "current_actor_state",
    ),
    "friction off the map": (
        t.Scenario(friction_maps=[t.RoadSurfacePatch(t.PositionalZone((900, 0), (20, 20)), 0, 10, 0.5)]),
        "friction_maps[0].zone",
        "890",
    ),
    "stop at the begin of a lane": (halting(0.05), f"{FLOW}.stops[0].offset", "0.1"),
    "stop at a named offset": (halting("max"), f"{FLOW}.stops[0].offset", "'max'"),
    "short stop": (
        flow(stops=[t.Stop("to_east", 0, 50, 5, length=0.05)]),
        f"{FLOW}.stops[0].length",
        "0.05",
    ),
    "stop before the begin": (
        flow(stops=[t.Stop("from_west", 0, 5, 5)]),
        f"{FLOW}.stops[0]",
        "'from_west'",
    ),
    "stops in wrong order": (halting(60, 30), f"{FLOW}.stops[1]", "30"),
    "stop behind the end": (
        flow(route=t.Route(("from_west", 0, 10), ("to_east", 0, 40)), stops=[t.Stop("to_east", 0, 50, 5)]),
        f"{FLOW}.stops[0]",
        "50",
    ),
    "stop on a random route": (
        flow(route=t.RandomRoute(), stops=[t.Stop("to_east", 0, 50, 5)]),
        f"{FLOW}.stops[0]",
        "random",
    ),
    "departs faster than it drives": (
        actor(depart_speed=9, max_speed=8),
        f"{ACTOR}.depart_speed",
        "8",
    ),
    "stands": (actor(speed=t.Distribution(0, 0)), f"{ACTOR}.speed", "0 times"),
    **{
        f"trip {name}": (traffic(trips=[t.Trip(name, WEST_EAST)]), TRIP_NAME, name)
        for name in ("slot-0-1", "try-again-1", "car-flow-0.0", "car-flow-0-3.5.12")
    },
    "group of one": (
        t.Scenario(social_agent_missions={"g": ([AGENT],)}),
        "social_agent_missions['g']",
        "",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_refused(case, roads):
    scenario, place, value = BAD[case]
    with pytest.raises(ScenarioError) as caught:
        validate(decode(encode(scenario)), roads, "scenario.py")
    assert caught.value.place.startswith(f"scenario.py: {place}")
    assert value in str(caught.value)
    assert caught.value.remedy
    assert len(str(caught.value)) < 500


def test_a_single_actor_is_a_group(roads):
    validate(t.Scenario(social_agent_missions={"g": (AGENT, [t.Mission(t.RandomRoute())])}), roads, "")


def test_what_is_on_the_way_or_beside_it_is_taken(roads):
    inside = t.JunctionEdgeIDResolver("from_west", 0, "to_east", 0)
    vias = [t.Via("from_west", 0, 20, 5), t.Via(inside, 0, 2, 5), t.Via("to_east", 0, 2, 5)]
    validate(mission(via=vias), roads, "")
    validate(turn(target_lane_index=9, initial_speed=0), roads, "")
    validate(trap(default_entry_speed=0, exclusion_prefixes=["car"]), roads, "")


def test_vias_of_laps_may_be_on_the_way_back(ring):
    route = t.Route(("south", 0, 10), ("east", 0, 30))
    via = [t.Via("north", 0, 10, 5)]
    validate(t.Scenario(ego_missions=[t.LapMission(route, 2, via=via)]), ring, "")
    with raises(ScenarioError, values=["north_0"]):
        validate(t.Scenario(ego_missions=[t.LapMission(route, 1, via=via)]), ring, "")


@pytest.mark.parametrize(
    ("missions", "place"),
    [
        ([t.EndlessMission(("ab", 0, 20))], ".begin"),
        ([t.Mission(t.Route(("ab", 0, 20), ("bc", 0, 20)))], ".route.begin"),
        ([t.Mission(t.Route(("ab", 1, 20), ("ab", 0, 60)))], ".route.end"),
        ([t.EndlessMission(("ab", 1, 20), via=[t.Via("ab", 0, 60, 5)])], ".via[0].lane_index"),
    ],
)
def test_missions_keep_off_sidewalks(fork, missions, place):
    with raises(ScenarioError, f"ego_missions[0]{place}", values=["'ab_0'"]):
        validate(t.Scenario(ego_missions=missions), fork, "")


def test_stops_keep_off_sidewalks(fork):
    stop = t.Stop("ab", 0, 50, 5)
    with raises(ScenarioError, ".stops[0]", values=["'ab_0'", "open: 1, 2"]):
        validate(flow(route=t.Route(("ab", 1, 5), ("bc", 0, 50)), stops=[stop]), fork, "")


def test_stops_may_follow_one_another_on_a_round(ring):
    route = t.Route(("south", 0, 30), ("south", 0, 20))
    stops = [t.Stop(edge, 0, offset, 5) for edge, offset in (("south", 50), ("east", 9), ("south", 9))]
    validate(flow(route=route, stops=stops), ring, "")


def test_stops_of_repeated_routes_may_lie_behind_their_end(ring):
    stop, route = t.Stop("east", 0, 60, 5), t.Route(("south", 0, 30), ("east", 0, 20))
    validate(flow(route=route, stops=[stop], repeat_route=True), ring, "")
    with raises(ScenarioError, ".stops[0]", values=[60]):
        validate(flow(route=route, stops=[stop]), ring, "")


def test_what_sumo_drives_is_taken(fork, roads):
    """SUMO ends routes in another lane than a closed one, and lets drivers be faster than they want."""
    validate(flow(route=t.Route(("ab", 1, 5), ("ab", 0, 50))), fork, "")
    validate(actor(depart_speed=20), roads, "")
    validate(
        t.Scenario(
            ego_missions=[t.GroupedLapMission(t.Route(("from_west", 1, 50), ("to_east", 1, 50)), 9, 1, 2, 1)]
        ),
        roads,
        "",
    )


def test_missions_may_use_bus_lanes(roads):
    kind = roads.kind.copy()
    kind[[roads.lane_number("from_west", 0), roads.lane_number("to_east", 0)]] = LaneKind.BUS
    with_buses = dataclasses.replace(roads, kind=kind)
    via = [t.Via("from_west", 0, 60, 5)]
    mission = t.Mission(t.Route(("from_west", 1, 20), ("to_east", 0, 50)), via=via)
    validate(t.Scenario(ego_missions=[mission, t.EndlessMission(("from_west", 0, 20))]), with_buses, "")


def test_names_beside_the_reserved_ones(roads):
    names = ("slot-1", "try-again", "try-again-soon", "car-flow-0", "flow.0")
    validate(traffic(trips=[t.Trip(name, WEST_EAST) for name in names]), roads, "")


def test_models_may_say_what_sumo_allows(roads):
    validate(lanes(strategic=-1, sigma=0, overtake_delta_speed_factor=-1), roads, "")
    validate(junctions(impatience="off", drive_after_red_time=-1, timegap_minor=-0.5), roads, "")


def test_sumo_itself_takes_the_ends_of_all_ranges(cross_net, tmp_path):
    """Refused are the values just outside, where SUMO has a bound of its own."""
    program = Path(sumo.__file__).parent / "bin" / "sumo"
    known = LANE_CHANGING | JUNCTIONS
    types = [
        f'<vType id="{name}-{number}" {name}="{value}"/>'
        for name, allowed in known.items()
        for number, value in enumerate((allowed.least, allowed.most, allowed.apart))
        if value is not None
    ]
    routes = tmp_path / "types.rou.xml"
    routes.write_text(f"<routes>{''.join(types)}</routes>")
    options = ["--net-file", cross_net, "--route-files", routes, "--end", "1", "--xml-validation", "never"]
    run = subprocess.run([program, *options, "--no-step-log"], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
