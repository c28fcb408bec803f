"""Missions drawn from lists of starts and goals: ways, conflicts, sets, and what an episode takes of them."""

from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
import shapely

from smarts.agents.options import InterfaceError
from smarts.agents.social import ALL_MISSIONS, Cast, SocialPolicy
from smarts.agents.spec import AgentSpec
from smarts.errors import ScenarioError
from smarts.sim.schedule import Schedule
from smarts.sim.social_starts import roles_of
from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario
from smarts.sstudio.drawn_missions import find_ways, meetings, with_sets
from smarts.sstudio.episodes import EpisodePlan, drawn_mission, episode_plans
from smarts.types.streams import Purpose, stream
from tests.maps import crossing, straight
from tests.raising import raises

from .sources import scenario

ARMS = ("west", "south", "east", "north")
HALF_WIDTH = 1.6
"""Width of its lanes [m]."""


def at_the_crossing(**given):
    starts = [(f"{arm}_in", 0, offset) for arm, offset in product(ARMS, (2, 30))]
    return t.DrawnMission(starts, [(f"{arm}_out", 0, 75) for arm in ARMS], **given)


def filled(drawn, roads, seed=42):
    return with_sets(drawn, roads, seed, "here")


def ways_of(drawn, roads):
    return [*find_ways(drawn, roads, "here")]


@pytest.mark.parametrize(("arrivals", "meet"), [(1.3, False), (1.34, True)])
def test_two_ways_meet_if_the_arrivals_at_the_crossing_are_near(arrivals, meet):
    # From the south, the other's lane begins 50 m ahead at 14 m/s, then 6.8 m at 10 m/s: 4.25 s;
    # from the west, 64 m and 10 m: 5.57 s.
    starts = [("south_in", 0, 30), ("west_in", 0, 16)]
    drawn = t.DrawnMission(starts, [("north_out", 0, 50), ("east_out", 0, 50)])
    roads = crossing()
    ways = [way for way in ways_of(drawn, roads) if way.start == way.goal]
    assert [way.length for way in ways] == pytest.approx([120, 134])
    assert meetings(roads, ways, arrivals).tolist() == [[False, meet], [meet, False]]


def swept(roads, drawn, way):
    """Return points of a way each 0.25 m, the times at which they are reached [s], and the way as a line."""
    lines = [
        (shapely.LineString(roads.centreline(leg.lane)), roads.speed_limit[leg.lane]) for leg in way.legs
    ]
    stations = [(line, s, limit) for line, limit in lines for s in np.arange(0.0, line.length, 0.25)]
    points = np.array([line.interpolate(s).coords[0] for line, s, _ in stations])
    times = np.cumsum([0.25 / limit for *_, limit in stations])
    begin = max(drawn.starts[way.start][2], 5.0)  # where the whole car is on its lane
    return points, times - begin / 14.0, shapely.LineString(points).simplify(0.01)


def arrivals_apart(first, second):
    """Return how far apart two agents reach each other's lane [s], infinite if they never do.

    NaN where the lanes only touch, which is a matter of definition.
    """
    times = []
    for (points, reached, _), (*_, line) in ((first, second), (second, first)):
        away = shapely.distance(shapely.points(points), line)
        if away.min() > 0.3:
            return np.inf if away.min() > 2 * HALF_WIDTH else np.nan
        times.append(reached[np.argmax(away < HALF_WIDTH)])
    return abs(times[0] - times[1])


def test_conflicts_are_those_that_a_sweep_over_the_whole_ways_finds():
    roads, drawn = crossing(), at_the_crossing(arrivals=1.0)
    ways = ways_of(drawn, roads)
    assert len(ways) == 8 * 3
    found = meetings(roads, ways, drawn.arrivals)
    assert (found == found.T).all()
    sweeps, compared = [swept(roads, drawn, way) for way in ways], 0
    for a, b in combinations(range(len(ways)), 2):
        if drawn.starts[ways[a].start][0] == drawn.starts[ways[b].start][0]:
            assert not found[a, b]  # one follows the other
            continue
        apart = arrivals_apart(sweeps[a], sweeps[b])
        # Of wide lanes at an angle, several places are where one reaches the other.
        if abs(apart - drawn.arrivals) > 0.4:
            assert found[a, b] == (apart < drawn.arrivals), (ways[a], ways[b], apart)
            compared += 1
    assert compared > 100
    assert 0.1 < found.mean() < 0.6


@pytest.mark.parametrize(("goal", "ways"), [(84.9, 0), (85.1, 1)])
def test_a_lane_change_takes_forty_metres(goal, ways):
    drawn = t.DrawnMission([("road", 0, 5)], [("road", 2, goal)])
    assert len(ways_of(drawn, straight(lanes=3))) == ways


@pytest.mark.parametrize("share", [0.0, 0.7, 1.0])
def test_sets_keep_what_the_scenario_asks_for(share):
    roads = crossing()
    drawn, note = filled(at_the_crossing(conflicts=share, arrivals=0.5), roads)
    ways = {(way.start, way.goal): way for way in ways_of(drawn, roads)}
    for chosen in drawn.sets:
        starts, goals = zip(*chosen, strict=True)
        assert len(chosen) == len({*starts}) == len({*goals}) == 4
        assert all(80 <= ways[pair].length <= 250 for pair in chosen)
    # The two that meet come first, so that the share holds for two agents.
    pairs = [[ways[pair] for pair in chosen[:2]] for chosen in drawn.sets]
    met = np.mean([meetings(roads, pair, 0.5).any() for pair in pairs])
    assert share <= met <= share + 0.2
    assert drawn.sets != filled(drawn, roads, seed=43)[0].sets
    told = float(note.partition(" of the sets")[0].rpartition("in ")[2].rstrip("%")) / 100
    assert told == pytest.approx(
        np.mean([meetings(roads, [ways[pair] for pair in each], 0.5).any() for each in drawn.sets]), abs=0.005
    )


def test_agents_may_share_goals_but_no_starts():
    drawn, _ = filled(at_the_crossing(distinct=False), crossing())
    assert any(len({goal for _, goal in chosen}) < 4 for chosen in drawn.sets)
    assert all(len({start for start, _ in chosen}) == 4 for chosen in drawn.sets)


def pair_of(drawn, mission):
    return drawn.starts.index(mission.route.begin), drawn.goals.index(mission.route.end)


def test_an_episode_deals_one_set_in_any_order():
    drawn, _ = filled(at_the_crossing(), crossing())
    plan, whole = EpisodePlan(None, (), drawn=drawn), {*map(tuple, drawn.sets)}
    orders = set()
    for seed in range(300):
        dealt = plan.dealt(4, stream(seed, Purpose.STARTS)).missions
        pairs = [pair_of(drawn, each) for each in dealt]
        fitting = [each for each in whole if sorted(each) == sorted(pairs)]
        assert fitting
        orders.add(tuple(fitting[0].index(pair) for pair in pairs))
        first = EpisodePlan(None, (), drawn=replace(drawn, sets=drawn.sets[:1]))
        of_two = first.dealt(2, stream(seed, Purpose.STARTS))
        assert sorted(pair_of(drawn, each) for each in of_two.missions) == sorted(drawn.sets[0][:2])
        assert [pair_of(drawn, each) for each in of_two.spare] == [*drawn.sets[0][2:]]
    assert len(orders) == 24


@pytest.mark.parametrize(
    ("given", "roads"),
    [
        ({"length": (300, 400)}, crossing()),  # no way is so long
        ({"arrivals": 0.0}, crossing()),  # no two ways meet
        ({"count": 5}, crossing()),  # there are four goals
    ],
)
def test_what_the_map_cannot_give_is_refused(given, roads):
    with raises(ScenarioError, "here"):
        filled(at_the_crossing(**given), roads)


def test_social_agents_take_the_missions_that_the_egos_leave_of_the_set():
    drawn, _ = filled(at_the_crossing(), crossing())
    cast = Cast((SocialPolicy("agent", "zoo:agent-v0", AgentSpec(), 0),), extra=((0, ALL_MISSIONS),))
    (plan,) = episode_plans(t.Scenario(ego_missions=[drawn]), 2)
    assert len(roles_of(plan, cast, "here")) == 2
    dealt = plan.dealt(2, stream(5, Purpose.STARTS))
    assert tuple(role.mission for role in roles_of(dealt, cast, "here")) == dealt.spare != plan.spare
    (plan,) = episode_plans(t.Scenario(ego_missions=[drawn]), 4)
    with raises(InterfaceError, "here", values=["0 missions"]):
        roles_of(plan, replace(cast, extra=((0, 2),)), "here")


BODY = """ego_missions=[t.DrawnMission(
    [(f"from_{arm}", lane, 40) for arm in ("west", "east", "north", "south") for lane in (0, 1)],
    [(f"to_{arm}", lane, 60) for arm in ("west", "east", "north", "south") for lane in (0, 1)],
)]"""


def test_the_build_draws_the_sets_and_says_so(scenario_folder, tmp_path):
    built = build_scenario(scenario_folder(scenario(BODY)))
    drawn = drawn_mission(built.scenario.ego_missions or ())
    assert drawn
    assert len(drawn.sets) == 256
    assert any("256 sets of 4" in note for note in built.notes)
    again = build_scenario(scenario_folder(scenario(BODY), name="again"))
    assert drawn_mission(again.scenario.ego_missions or ()) == drawn
    schedule = Schedule([built], ["a", "b", "c"])
    assert len(schedule.combinations) == 1
    starts = [schedule.start(world, 0) for world in range(12)]
    assert len({tuple(agent.mission.goal_position for agent in start.agents) for start in starts}) > 6
    # An episode is the same whatever else was drawn before.
    assert Schedule([built], ["a", "b", "c"]).start(7, 0) == starts[7]


@pytest.mark.parametrize(
    "body",
    [
        BODY.replace("60) for", '"random") for'),
        f"{BODY[:-1]}, t.Mission(south_north)]",
        BODY.replace(",\n)]", ", length=100)]"),
        BODY.replace(",\n)]", ", length=(250, 80))]"),
        BODY.replace(",\n)]", ", distinct='no')]"),
        BODY.replace(",\n)]", ", count=2.5)]"),
        "ego_missions=[t.DrawnMission([], [('to_west', 0, 60)])]",
    ],
)
def test_scenarios_that_cannot_draw_are_refused(body, scenario_folder):
    with pytest.raises(ScenarioError, match="ego_missions"):
        build_scenario(scenario_folder(scenario(body)))
