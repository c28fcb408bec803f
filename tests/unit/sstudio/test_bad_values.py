"""Values that do not fit the map, the route, or each other, and neighbouring ones that do."""

import dataclasses

import pytest

from smarts.errors import ScenarioError
from smarts.roads.lane_graph import LaneKind
from smarts.sstudio import types as t
from tests.raising import raises

from .sources import validate

CAR = t.TrafficActor("car")
WEST_EAST = t.Route(("from_west", 0, 10), ("to_east", 0, "max"))
AGENT = t.SocialAgentActor("agent", "zoo:agent-v0")


def flow(**changes):
    flow = t.Flow(**({"route": WEST_EAST, "rate": 60, "actors": {CAR: 1}} | changes))
    return t.Scenario(traffic={"x": t.Traffic([flow])})


def actor(**changes):
    return flow(actors={t.TrafficActor("car", **changes): 1})


def halting(*offsets):
    return flow(stops=[t.Stop("to_east", 0, offset, 5) for offset in offsets])


def trips(*names):
    return t.Scenario(traffic={"x": t.Traffic([], trips=[t.Trip(name, WEST_EAST) for name in names])})


def mission(begin=("from_west", 0, 10), end=("to_east", 0, 50), **changes):
    return t.Scenario(ego_missions=[t.Mission(t.Route(begin, end), **changes)])


def turn(end=("to_west", 0, 60), **changes):
    return mission(end=end, task=t.UTurn(**changes))


FLOW = "traffic['x'].flows[0]"
ACTOR = f"{FLOW}.actors['car']"
TASK, TACTIC, VIA = (f"ego_missions[0].{part}" for part in ("task", "entry_tactic", "via[0]"))
BAD = {
    "start speed": (turn(initial_speed="5"), f"{TASK}.initial_speed", "'5'"),
    "prefixes as text": (
        mission(entry_tactic=t.TrapEntryTactic(exclusion_prefixes="car")),
        f"{TACTIC}.exclusion_prefixes",
        "'car'",
    ),
    "via off the route": (mission(via=[t.Via("to_south", 0, 10, 5)]), f"{VIA}.road_id", "to_south_0"),
    "via in another turn": (
        mission(via=[t.Via(t.JunctionEdgeIDResolver("from_west", 0, "to_south", 0), 0, 2, 5)]),
        f"{VIA}.road_id",
        "route does not pass",
    ),
    "turn across": (turn(end=("to_south", 0, 60)), TASK, "to_south"),
    "turn far ahead": (turn(end=("from_east", 0, 60)), TASK, "from_east"),
    "rate as truth": (flow(rate=True), f"{FLOW}.rate", "True"),
    "end without an end": (flow(end=float("inf")), f"{FLOW}.end", "inf"),
    "sigma": (actor(sigma=7), f"{ACTOR}.sigma", "at most 1"),
    "uniform": (actor(min_gap=t.UniformDistribution(0, float("nan"))), f"{ACTOR}.min_gap.b", "nan"),
    "model's value": (
        actor(junction_model=t.JunctionModel(impatience="x")),
        f"{ACTOR}.junction_model",
        "'x'",
    ),
    "model as a dict": (actor(junction_model={"impatience": 1}), f"{ACTOR}.junction_model", "dict"),
    "stands": (actor(speed=t.Distribution(0, 0)), f"{ACTOR}.speed", "0 times"),
    "departs too fast": (actor(depart_speed=9, max_speed=8), f"{ACTOR}.depart_speed", "8"),
    "backwards": (mission(("from_west", 0, 50), ("from_west", 0, 10)), "ego_missions[0].route", "40"),
    "end within the vehicle": (mission(("to_east", 0, 0), ("to_east", 0, 3)), "ego_missions[0].route", "2 m"),
    "inside a junction": (
        t.Scenario(ego_missions=[t.EndlessMission((":centre_0", 0, 0.1))]),
        "ego_missions[0].begin",
        "junction",
    ),
    "condition on a vehicle": (
        mission(entry_tactic=t.IdEntryTactic(actor_id="car", condition=t.VehicleSpeedCondition(0, 9))),
        f"{TACTIC}.condition",
        "current_actor_state",
    ),
    "friction off the map": (
        t.Scenario(friction_maps=[t.RoadSurfacePatch(t.PositionalZone((900, 0), (20, 20)), 0, 10, 0.5)]),
        "friction_maps[0].zone",
        "890",
    ),
    "stop before the begin": (flow(stops=[t.Stop("from_west", 0, 5, 5)]), f"{FLOW}.stops[0]", "from_west"),
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
    "reserved name": (trips("car-flow-0-3.5.12"), "traffic['x'].trips[0].vehicle_name", "car-flow-0-3.5.12"),
}


@pytest.mark.parametrize("case", BAD)
def test_refused(case, roads):
    scenario, place, value = BAD[case]
    with raises(ScenarioError, values=[f"scenario.py: {place}", value, "remedy"]):
        validate(scenario, roads, "scenario.py")


def test_a_single_actor_is_a_group(roads):
    validate(t.Scenario(social_agent_missions={"g": (AGENT, [t.Mission(t.RandomRoute())])}), roads, "")


def test_what_is_on_the_way_or_beside_it_is_taken(roads):
    inside = t.JunctionEdgeIDResolver("from_west", 0, "to_east", 0)
    vias = [t.Via("from_west", 0, 20, 5), t.Via(inside, 0, 2, 5), t.Via("to_east", 0, 2, 5)]
    validate(mission(via=vias), roads, "")
    validate(turn(target_lane_index=9, initial_speed=0), roads, "")
    tactic = t.TrapEntryTactic(default_entry_speed=0, exclusion_prefixes=["car"])
    validate(mission(entry_tactic=tactic), roads, "")


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
    validate(trips("slot-1", "try-again", "try-again-soon", "car-flow-0", "flow.0"), roads, "")


def test_models_may_say_what_sumo_allows(roads):
    validate(actor(lane_changing_model=t.LaneChangingModel(strategic=-1, sigma=0)), roads, "")
    validate(actor(junction_model=t.JunctionModel(impatience="off", timegap_minor=-0.5)), roads, "")
