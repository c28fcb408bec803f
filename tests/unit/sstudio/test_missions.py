import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smarts.errors import ScenarioError
from smarts.sstudio import types as t
from smarts.sstudio.episodes import episode_plans, expand, mission_sets
from smarts.sstudio.missions import GAP, keep_apart, place_missions
from smarts.types.streams import Purpose, stream
from tests.maps import Road, graph_of
from tests.raising import raises


def generator(seed=0):
    return stream(seed, Purpose.STARTS)


def mission(begin=("from_west", 0, 20), end=("to_east", 0, 50), **more):
    return t.Mission(t.Route(begin, end), **more)


def place(roads, *missions, seed=0, **more):
    return place_missions(missions, roads, generator(seed), **more)


class TestPlacing:
    def test_a_fixed_mission(self, roads):
        (placed,) = place(roads, mission())
        lane = roads.lane_number("from_west", 0)
        assert (placed.start.lane, placed.start.s) == (lane, 20)
        # The offset is the front bumper's, so the centre is half a car's length before it.
        assert placed.start.pose(roads, behind=2.5) == pytest.approx(roads.pose_at(lane, 17.5))
        assert placed.goal is not None
        assert (placed.goal.lane, placed.goal.s) == (roads.lane_number("to_east", 0), pytest.approx(50))
        assert placed.route == ("from_west", "to_east")
        assert (placed.speed, placed.start_time, placed.via) == (0, 0, ())

    @pytest.mark.parametrize(("offset", "s"), [(0, 5), (4.9, 5), (5.1, 5.1)])
    def test_the_whole_car_is_on_its_lane(self, roads, offset, s):
        for first in (mission(("from_west", 0, offset)), t.EndlessMission(("from_west", 0, offset))):
            (placed,) = place(roads, first)
            assert placed.start.s == pytest.approx(s)

    def test_the_same_generator_places_the_same(self, roads):
        missions = [t.Mission(t.RandomRoute("a")), mission(("from_south", 1, "random"))]
        variation = t.StartVariation()
        assert place(roads, *missions, variation=variation) == place(roads, *missions, variation=variation)

    def test_vias(self, roads):
        via = (
            t.Via("from_west", 0, 40, required_speed=5),
            t.Via(t.JunctionEdgeIDResolver("from_west", 0, "to_south", 0), 0, 2, 3, hit_distance=4),
        )
        (placed,) = place(roads, mission(end=("to_south", 0, 9), via=via))
        first, second = placed.via
        lane = roads.lane_number("from_west", 0)
        assert (first.point.lane, first.point.s, first.required_speed) == (lane, 40, 5)
        assert first.hit_distance == pytest.approx(roads.width[lane] / 2)
        assert roads.is_internal[second.point.lane]
        assert second.hit_distance == 4

    @pytest.mark.parametrize(
        ("arguments", "time"),
        [
            ({}, 0),
            ({"start_time": 3}, 3),
            ({"entry_tactic": t.TrapEntryTactic(4)}, 4),
            ({"start_time": 3, "entry_tactic": t.TrapEntryTactic(4)}, 3),
            ({"start_time": 3, "entry_tactic": t.TrapEntryTactic(wait_to_hijack_limit_s=1)}, 3),
        ],
    )
    def test_start_times(self, roads, arguments, time):
        assert place(roads, mission(**arguments))[0].start_time == time

    def test_speeds(self, roads):
        variation = t.StartVariation(speed=(2, 4))
        speeds = [place(roads, mission(), seed=seed, variation=variation)[0].speed for seed in range(50)]
        assert 2 <= min(speeds) < 2.3
        assert 3.7 < max(speeds) <= 4
        named = mission(("from_west", 0, 1), ("to_west", 0, 1), task=t.UTurn(initial_speed=7))
        assert place(roads, named, variation=variation)[0].speed == 7
        trapped = mission(entry_tactic=t.TrapEntryTactic(default_entry_speed=6))
        assert place(roads, trapped, variation=variation)[0].speed == 6


class TestStarts:
    def test_random_starts_find_room(self, roads):
        missions = [mission(("from_west", 0, "random")) for _ in range(4)]
        for seed in range(30):
            starts = sorted(placed.start.s for placed in place(roads, *missions, seed=seed))
            assert np.diff(starts).min() >= 5 + GAP

    def test_too_many_random_starts_are_refused(self, roads):
        with raises(ScenarioError, values=["mission 9"]):
            place(roads, *[mission(("from_west", 0, "random")) for _ in range(30)])

    def test_overlapping_starts_are_refused(self, roads):
        with raises(ScenarioError, values=[20, "from_west_0", 22]):
            place(roads, mission(), mission(("from_west", 0, 22)))

    @given(
        gaps=st.lists(st.floats(5, 30), max_size=5),
        first=st.floats(0, 20),
        reach=st.floats(0, 10),
        slack=st.floats(0, 10),
        data=st.data(),
    )
    def test_kept_apart_whatever_is_drawn(self, gaps, first, reach, slack, data):
        nominal = [first + sum(gaps[:rank]) for rank in range(len(gaps) + 1)]
        lane_length = nominal[-1] + slack
        drawn = [start + data.draw(st.floats(-reach, reach)) for start in nominal]
        starts = keep_apart(nominal, drawn, reach, lane_length, 5.0)
        assert starts is not None
        for start, wanted in zip(starts, nominal, strict=True):
            assert (
                wanted - reach - 1e-9 <= start <= min(max(wanted + reach, wanted), lane_length) + reach + 1e-9
            )
            assert min(wanted, 5.0) - 1e-9 <= start <= lane_length + 1e-9
        for rank, gap in enumerate(gaps):
            assert starts[rank + 1] - starts[rank] >= min(gap, 5 + GAP) - 1e-6


class TestLaps:
    @pytest.mark.parametrize(
        ("begin", "end", "laps", "route"),
        [
            (("south", 0, 30), ("south", 0, 60), 2, "south east north west south"),
            (("south", 0, 30), ("south", 0, 10), 1, "south east north west south"),
            (("south", 0, 30), ("south", 0, 10), 2, "south east north west south east north west south"),
            (("south", 0, "max"), ("south", 0, 10), 1, "south east north west south"),
            (("south", 0, 0), ("south", 0, 3), 1, "south east north west south"),
            (("south", 0, "random"), ("south", 0, 30), 1, "south"),
            (("south", 0, 30), ("east", 0, 10), 2, "south east north west south east"),
            (("south", 0, 30), ("west", 0, 10), 2, "south east north west south east north west"),
        ],
    )
    def test_laps_go_round(self, ring, begin, end, laps, route):
        (placed,) = place(ring, t.LapMission(t.Route(begin, end), num_laps=laps))
        assert " ".join(placed.route) == route

    @pytest.mark.parametrize(("laps", "route"), [(1, "a x y a"), (3, "a x y a x y a x y a")])
    def test_every_lap_goes_by_the_vias(self, laps, route):
        """Also where there is a shorter way round, by b."""
        ways = {
            "a": [(0, 0), (60, 0)],
            "b": [(70, 5), (-10, 5)],
            "x": [(70, -5), (70, -60)],
            "y": [(60, -60), (-5, -5)],
        }
        pairs = [("a", "b"), ("b", "a"), ("a", "x"), ("x", "y"), ("y", "a")]
        graph = graph_of(
            {name: Road(points) for name, points in ways.items()}, [((a, 0), (b, 0)) for a, b in pairs]
        )
        lap = t.Route(("a", 0, 5), ("a", 0, 50), via=("x", "y"))
        (placed,) = place(graph, t.LapMission(lap, num_laps=laps))
        assert " ".join(placed.route) == route

    def test_groups_start_on_a_grid(self):
        group = t.GroupedLapMission(t.Route(("a", 1, 50), ("b", 0, 20)), 10, 2, actor_count=3, num_laps=4)
        starts = [(lap.route.begin, lap.route.end, lap.num_laps) for lap in expand([group])]
        assert starts == [
            (("a", 1, 50), ("b", 0, 20), 4),
            (("a", 0, 40), ("b", 1, 20), 4),
            (("a", 1, 30), ("b", 0, 20), 4),
        ]


class TestEpisodes:
    scenario = t.Scenario(
        traffic={"none": t.Traffic(flows=[]), "some": t.Traffic(flows=[])},
        ego_missions=[mission(("from_west", 0, offset)) for offset in (10, 20, 30)],
    )

    def test_one_agent_takes_turns_with_missions_and_traffic(self):
        plans = episode_plans(self.scenario, 1)
        assert [(plan.traffic, plan.missions[0].route.begin[2]) for plan in plans] == [
            (name, offset) for name in ("none", "some") for offset in (10, 20, 30)
        ]

    def test_as_many_agents_as_missions_share_them_out(self):
        plans = episode_plans(self.scenario, 3)
        assert [plan.traffic for plan in plans] == ["none", "some"]
        assert list(plans[0].missions) == self.scenario.ego_missions

    def test_fewer_agents_reach_every_mission(self):
        sets = mission_sets(self.scenario.ego_missions, 2)
        assert [[m.route.begin[2] for m in missions] for missions in sets] == [[10, 20], [30, 10]]

    def test_more_agents_than_missions_are_refused(self):
        with raises(ScenarioError, values=[4, 3]):
            episode_plans(self.scenario, 4)

    def test_without_missions_everyone_roams(self):
        (plan,) = episode_plans(t.Scenario(), 2)
        assert plan.traffic is None
        assert len(set(plan.missions)) == 2
        assert all(isinstance(mission.route, t.RandomRoute) for mission in plan.missions)


def test_starts_and_goals_count_as_sumo_does(long_roads):
    """The lane is drawn 100 m long and counts 200 m, so SUMO's 160 m are 80 m of it."""
    mission = t.Mission(t.Route(("one", 0, 160), ("two", 0, 50)))
    (placed,) = place_missions([mission], long_roads, generator(0))
    assert placed.start.s == pytest.approx(160 * long_roads.length[placed.start.lane] / 200)
    assert placed.goal.s == pytest.approx(50)
