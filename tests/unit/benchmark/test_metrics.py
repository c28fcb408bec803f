"""Each metric on episodes that can be worked out by hand."""

import math

import numpy as np
import pytest

from benchmark.metrics.encounters import COLLIDED, WENT_FIRST, YIELDED, find_encounters
from benchmark.metrics.leaders import time_to_collision
from benchmark.metrics.registry import ELEVEN, METRICS
from smarts.types.actions import LaneAction
from smarts.types.events import Outcome
from tests.recordings import (
    DT,
    LENGTH,
    Drive,
    across,
    at_speed,
    at_speeds,
    crossroads,
    episode_of,
    lane_drop,
    straight,
)

ROAD = straight(lanes=3, length=400.0)
CROSS = crossroads()
WEST_EAST, SOUTH_NORTH = ("west_in", "east_out"), ("south_in", "north_out")
SLOWLY, QUICKLY = [10.0] * 10 + [3.0] * 50 + [10.0] * 60, [10.0] * 120


def totals(*episodes, times: int = 1) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    for episode in episodes:
        rows = {"agents": episode.entered.astype(float)}
        for metric in METRICS.values():
            rows |= metric.measure(episode)
        for name, column in rows.items():
            found[name] = found.get(name, np.array(0.0)) + times * column.sum()
    return found


def value(name: str, *episodes, times: int = 1) -> float:
    return float(METRICS[name].value(totals(*episodes, times=times)))


def term(name: str, which: str, *episodes) -> float:
    return float(METRICS[name].terms(totals(*episodes))[which])


def meeting(folder, mine, others, *, outcome=Outcome.GOAL, partner=-1, begin=30.0, other_begin=20.0):
    """An agent from the west, 57.6 m before the crossing strip; a vehicle from the south, 64.4 m before."""
    return episode_of(
        folder,
        CROSS,
        Drive(
            across(CROSS, *WEST_EAST),
            at_speeds(mine, begin),
            agent="a",
            route=WEST_EAST,
            outcome=outcome,
            partner=partner,
        ),
        Drive(across(CROSS, *SOUTH_NORTH), at_speeds(others, other_begin), route=SOUTH_NORTH),
    )


def following(folder, t, *, speed=8.0, steps=150, gap=20.0, **more):
    """An agent 20 m behind a vehicle that wants 5 m/s, its place across the road as given."""
    return episode_of(
        folder,
        ROAD,
        Drive(
            ["road_0"],
            at_speed(speed, steps, 10.0),
            t=t,
            agent="a",
            desired_speed=13.0,
            route=["road"],
            **more,
        ),
        Drive(["road_0"], at_speed(5.0, steps, 10.0 + gap + LENGTH), desired_speed=5.0, route=["road"]),
    )


def test_the_eleven_come_first_and_names_agree():
    assert ELEVEN[0] == "collision_rate"
    assert ELEVEN[-1] == "competitive"
    assert all(METRICS[name].name == name for name in METRICS)
    assert [name for name in METRICS if METRICS[name].is_axis] == [
        "safety",
        "agility",
        "stability",
        "control_diversity",
    ]


class TestEncounters:
    def test_a_scripted_yielder(self, tmp_path):
        gives_way = meeting(tmp_path, SLOWLY, QUICKLY)
        stays_behind = following(tmp_path, 0.0, speed=5.0)
        assert value("collaborative", gives_way) == 1.0
        assert value("competitive", stays_behind, times=10) == 0.0

    def test_a_scripted_overtaker(self, tmp_path):
        goes_first = meeting(tmp_path, QUICKLY, SLOWLY)
        moves_out = np.clip((np.arange(151) - 20) * 0.16, 0.0, 3.2)
        passes = following(tmp_path, moves_out)
        assert value("collaborative", goes_first) == 0.0
        assert value("competitive", passes, times=10) == 1.0

    def test_post_encroachment_time_is_from_the_rear_of_the_first_to_the_front_of_the_second(self, tmp_path):
        # The strip begins 89.6 m along the agent's way, and ends 90.4 m along the other's.
        found = find_encounters(meeting(tmp_path, SLOWLY, QUICKLY))
        other_leaves = (90.4 + LENGTH / 2 - 20.0) / 10.0
        agent_arrives = 6.0 + (89.6 - LENGTH / 2 - 55.0) / 10.0
        assert found.result.tolist() == [YIELDED]
        assert found.gap_time == pytest.approx([agent_arrives - other_leaves], abs=0.15)

    def test_near_misses_are_unsafe_and_collisions_have_no_gap(self, tmp_path):
        near = meeting(tmp_path, [10.0] * 10 + [8.0] * 50 + [10.0] * 40, QUICKLY)
        wide = meeting(tmp_path, SLOWLY, QUICKLY)
        crash = meeting(tmp_path, [10.0] * 60, [11.0] * 60, outcome=Outcome.COLLISION, partner=1)
        assert term("safety", "post_encroachment_time", near) == 0.0
        assert term("safety", "post_encroachment_time", wide) == 1.0
        assert find_encounters(crash).result.tolist() == [COLLIDED]
        assert find_encounters(crash).gap_time.tolist() == [0.0]
        assert value("collaborative", crash) == 0.0

    def test_none_where_arrivals_are_more_than_three_seconds_apart(self, tmp_path):
        # Predicted: agent 5.76 s; other (86.4 - 2 - s) / 10.
        apart = meeting(tmp_path, QUICKLY, QUICKLY, other_begin=-4.0)
        close = meeting(tmp_path, QUICKLY, QUICKLY, other_begin=-2.0)
        assert len(find_encounters(apart).agent) == 0
        assert len(find_encounters(close).agent) == 1

    def test_one_that_could_not_be_won_is_not_counted(self, tmp_path):
        # At +3 m/s^2, 37.6 m take 2.7 s and 57.6 m take 3.7 s; the other needs 1.44 s or 3.94 s.
        hopeless = meeting(tmp_path, [10.0] * 5 + SLOWLY, QUICKLY, begin=50.0, other_begin=70.0)
        hopeful = meeting(tmp_path, SLOWLY, QUICKLY, other_begin=45.0)
        assert find_encounters(hopeless).could_win.tolist() == [False]
        assert find_encounters(hopeful).could_win.tolist() == [True]
        assert math.isnan(value("collaborative", hopeless))

    def test_who_never_clears_the_crossing_has_not_given_way(self, tmp_path):
        stops = [10.0] * 10 + [5.0] * 40 + [0.0] * 150
        episode = meeting(tmp_path, stops, QUICKLY + [0.0] * 80, outcome=Outcome.TIME_OUT)
        found = totals(episode)
        assert found["unresolved_encounters"] == 1.0
        assert math.isnan(value("collaborative", episode))

    def test_a_merge_by_changing_lanes_where_a_lane_ends(self, tmp_path):
        graph = lane_drop()
        lane = ["before_1", ":junction_0_0", "after_0"]
        # The agent on the lane that ends falls behind, and changes lanes after 4 s.
        moves_over = np.clip((np.arange(101) - 30) * 0.16, 0.0, 3.2)
        agent = Drive(
            ["before_0"], at_speed(5.0, 100, 10.0), t=moves_over, agent="a", route=("before", "after")
        )
        other = Drive(lane, at_speed(8.0, 100, 12.0), route=("before", "after"))
        found = find_encounters(episode_of(tmp_path, graph, agent, other))
        assert found.result.tolist() == [YIELDED]
        swapped = find_encounters(
            episode_of(
                tmp_path,
                graph,
                Drive(lane, at_speed(8.0, 100, 12.0), agent="a", route=("before", "after")),
                Drive(["before_0"], at_speed(5.0, 100, 10.0), t=moves_over, route=("before", "after")),
            )
        )
        assert swapped.result.tolist() == [WENT_FIRST]

    def test_two_that_stay_in_lanes_of_their_own_do_not_meet(self, tmp_path):
        beside = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(8.0, 50), agent="a", route=["road"]),
            Drive(["road_1"], at_speed(8.0, 50), route=["road"]),
        )
        assert len(find_encounters(beside).agent) == 0
        assert math.isnan(value("collaborative", beside))


class TestCutIn:
    @pytest.mark.parametrize(("headway", "cut_ins"), [(0.9, 1.0), (1.1, 0.0)])
    def test_headway_of_the_vehicle_behind(self, tmp_path, headway, cut_ins):
        # The footprint is wholly in the new lane from t = 2.5 m on: 1.6 m + half of 1.8 m.
        moves_over = np.clip((np.arange(61) - 20) * 0.25, 0.0, 3.2)
        first_within = int(np.argmax(moves_over >= 2.5 - 1e-9))
        place = 100.0 + 10.0 * DT * first_within
        behind = place - LENGTH - headway * 10.0
        episode = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(10.0, 60, 100.0), t=moves_over, agent="a", route=["road"]),
            Drive(["road_1"], at_speed(10.0, 60, behind - 10.0 * DT * first_within), route=["road"]),
        )
        found = totals(episode)
        assert found["lane_changes"] == 1.0
        assert found["cut_ins"] == cut_ins

    def test_a_standing_vehicle_behind_is_not_cut_in_on(self, tmp_path):
        moves_over = np.clip((np.arange(61) - 20) * 0.25, 0.0, 3.2)
        episode = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(2.0, 60, 100.0), t=moves_over, agent="a", route=["road"]),
            Drive(["road_1"], at_speed(0.9, 60, 98.0), route=["road"]),
        )
        assert value("cut_in_ratio", episode) == 0.0

    def test_no_lane_change_is_nothing_to_measure(self, tmp_path):
        wavers = np.concatenate([np.linspace(0.0, 2.0, 30), np.linspace(2.0, 0.0, 31)])
        episode = episode_of(
            tmp_path, ROAD, Drive(["road_0"], at_speed(10.0, 60), t=wavers, agent="a", route=["road"])
        )
        assert math.isnan(value("cut_in_ratio", episode))


class TestSafety:
    def test_time_to_collision_along_the_lane(self, tmp_path):
        # 20 m apart, bumper to bumper, closing at 10 m/s.
        times = time_to_collision(following(tmp_path, 0.0, speed=15.0, steps=10))
        assert times[:, 0] == pytest.approx(2.0 - DT * np.arange(11))

    def test_it_follows_the_path_into_the_junction(self, tmp_path):
        lanes = across(CROSS, *WEST_EAST)
        episode = episode_of(
            tmp_path,
            CROSS,
            Drive(lanes, at_speed(10.0, 10, 60.0), agent="a", route=WEST_EAST),
            Drive(lanes, at_speed(0.0, 10, 84.0), route=WEST_EAST),
        )
        assert time_to_collision(episode)[0, 0] == pytest.approx(2.0)

    def test_nobody_beside_and_nobody_faster_counts(self, tmp_path):
        episode = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(10.0, 10), agent="a", route=["road"]),
            Drive(["road_1"], at_speed(0.0, 10, 20.0)),
            Drive(["road_0"], at_speed(12.0, 10, 30.0)),
        )
        assert np.isinf(time_to_collision(episode)).all()

    def test_share_of_time_and_terms_without_encounters(self, tmp_path):
        # 2.0 s at first, 0.1 s less each step: above 1.5 s at five of eleven instants.
        episode = following(tmp_path, 0.0, speed=15.0, steps=10)
        assert term("safety", "time_to_collision", episode) == pytest.approx(5 / 11)
        assert math.isnan(term("safety", "post_encroachment_time", episode))
        assert value("safety", episode) == pytest.approx((1.0 + 5 / 11) / 2)

    def test_a_parked_car_has_no_driving_time(self, tmp_path):
        episode = parked(tmp_path)
        assert math.isnan(term("safety", "time_to_collision", episode))


def parked(folder):
    return episode_of(
        folder,
        CROSS,
        Drive(across(CROSS, *WEST_EAST), at_speed(0.0, 100, 70.0), agent="a", route=WEST_EAST),
        Drive(across(CROSS, *SOUTH_NORTH), at_speed(10.0, 100, 20.0), route=SOUTH_NORTH),
    )


def test_a_parked_car_is_neither_stable_nor_collaborative(tmp_path):
    episode = parked(tmp_path)
    for name in ("stability", "collaborative", "cut_in_ratio", "competitive", "agility", "stochasticity"):
        assert math.isnan(value(name, episode)), name


class TestStability:
    def index(self, folder, steps=100, **drive):
        return value(
            "stability",
            episode_of(
                folder, ROAD, Drive(["road_0"], at_speed(5.0, steps), agent="a", route=["road"], **drive)
            ),
        )

    def test_perfectly_smooth(self, tmp_path):
        assert self.index(tmp_path, acceleration=1.0) == 1.0

    def test_jerk_of_accelerations_averaged_over_half_a_second(self, tmp_path):
        # Rising by 0.2 m/s^2 each step: a jerk of 2 m/s^3, which halves the index.
        assert self.index(tmp_path, acceleration=0.2 * np.arange(101)) == pytest.approx(0.5)
        # To and fro each step: the average over five moves by 2 / 5 of the swing of 1 m/s^2.
        swings = np.where(np.arange(101) % 2, 0.5, -0.5)
        assert self.index(tmp_path, acceleration=swings) == pytest.approx(1 / (1 + 0.2 / DT / 2.0))

    def test_lateral_acceleration(self, tmp_path):
        assert self.index(tmp_path, acceleration=0.0, lateral_acceleration=-1.5) == pytest.approx(0.5)

    def test_offset_from_the_lane_and_not_that_of_lane_changes(self, tmp_path):
        sways = np.where(np.arange(101) % 2, 0.5, -0.5)
        assert self.index(tmp_path, acceleration=0.0, t=sways) == pytest.approx(0.5, abs=1e-3)
        changes = np.concatenate([np.zeros(40), np.linspace(0.8, 2.4, 20), np.full(41, 3.2)])
        assert self.index(tmp_path, acceleration=0.0, t=changes) == pytest.approx(1.0)

    def test_two_seconds_above_walking_pace_are_needed(self, tmp_path):
        assert math.isnan(self.index(tmp_path, steps=15))


class TestDecisions:
    def drive(self, folder, actions=(), extras=(), legal=15):
        return episode_of(
            folder,
            ROAD,
            Drive(
                ["road_1"],
                at_speed(5.0, 200),
                agent="a",
                route=["road"],
                actions=list(enumerate(actions)),
                extras=extras,
                legal=legal,
            ),
        )

    def test_control_diversity(self, tmp_path):
        slow, left, keep = LaneAction.slow_down, LaneAction.change_lane_left, LaneAction.keep_lane
        assert (
            value("control_diversity", self.drive(tmp_path, [slow] * 10 + [left] * 10 + [keep] * 50)) == 1.0
        )
        assert value("control_diversity", self.drive(tmp_path, [slow] * 20)) == 0.0
        quarter = -(0.75 * math.log2(0.75) + 0.25 * math.log2(0.25))
        split = self.drive(tmp_path, [slow] * 15 + [left] * 5)
        assert value("control_diversity", split) == pytest.approx(quarter)
        assert term("control_diversity", "longitudinal_share", split) == 0.75
        assert math.isnan(value("control_diversity", self.drive(tmp_path, [slow] * 19)))

    def test_stochasticity_is_entropy_over_that_of_the_legal_actions(self, tmp_path):
        even_of_two = [(0, "probabilities", (0.5, 0.5, 0.0, 0.0))]
        assert value("stochasticity", self.drive(tmp_path, [0], even_of_two, legal=0b0011)) == pytest.approx(
            1.0
        )
        assert value("stochasticity", self.drive(tmp_path, [0], even_of_two)) == pytest.approx(0.5)
        certain = [*even_of_two, (1, "probabilities", (1.0, 0.0, 0.0, 0.0))]
        assert value("stochasticity", self.drive(tmp_path, [0, 0], certain)) == pytest.approx(0.25)
        only_one = [(0, "probabilities", (1.0, 0.0, 0.0, 0.0))]
        assert math.isnan(value("stochasticity", self.drive(tmp_path, [0], only_one, legal=0b0001)))

    def test_stochasticity_of_continuous_actions_is_cut_at_one(self, tmp_path):
        extras = [(0, "std", (0.2, 0.4)), (1, "std", (3.0, 3.0))]
        assert value("stochasticity", self.drive(tmp_path, [0, 0], extras)) == pytest.approx(0.65)

    def test_decisions_per_second_and_return(self, tmp_path):
        extras = [(0, "reward", (0.5,)), (1, "reward", (-2.0,))]
        episode = self.drive(tmp_path, [0] * 40, extras)
        assert value("decision_rate", episode) == pytest.approx(2.0)
        assert value("return", episode) == pytest.approx(-1.5)


class TestOutcomes:
    def test_rates_and_shares_sum_to_one(self, tmp_path):
        ends = [outcome for outcome in Outcome if Outcome.NONE < outcome < Outcome.VOID]
        drives = [
            Drive(["road_0"], at_speed(5.0, 10, 20.0 * number), agent=f"a{number}", outcome=outcome)
            for number, outcome in enumerate(ends)
        ]
        found = totals(episode_of(tmp_path, ROAD, *drives))
        shares = [
            "collision_rate",
            "completion_rate",
            *(name for name in METRICS if name.startswith("ended_")),
        ]
        assert [float(METRICS[name].value(found)) for name in shares] == [pytest.approx(1 / 9)] * 9

    def test_agility_and_progress(self, tmp_path):
        done = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(5.0, 100), agent="a", outcome=Outcome.GOAL, free_flow_time=4.0),
            Drive(["road_2"], at_speed(2.0, 100), agent="b", outcome=Outcome.TIME_OUT, remaining=30.0),
        )
        assert value("agility", done) == pytest.approx(0.4)
        assert value("progress_speed", done) == pytest.approx(3.5)
        assert value("goal_distance", done) == pytest.approx(15.0)

    @pytest.mark.parametrize(("headway", "caused"), [(1.0, 1.0), (9.0, 0.0)])
    def test_hard_brakes_caused(self, tmp_path, headway, caused):
        brakes = np.where(np.arange(101) == 50, -4.5, 0.0)
        episode = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(10.0, 100, 100.0), agent="a", route=["road"]),
            Drive(
                ["road_0"], at_speed(10.0, 100, 96.0 - 10.0 * headway), acceleration=brakes, route=["road"]
            ),
        )
        assert totals(episode)["hard_brakes"] == caused
        assert value("hard_brakes", episode) == pytest.approx(caused / 0.1)


def test_generalization_is_what_is_left_of_both_rates():
    names = ("train_agents", "train_goals", "train_collisions", "held_out_agents", "held_out_goals")
    found = dict(zip(names, (100.0, 90.0, 10.0, 50.0, 25.0), strict=True)) | {"held_out_collisions": 0.0}
    measure = METRICS["generalization"]
    # Completion falls from 0.9 to 0.5; there are fewer collisions, which makes up for nothing.
    assert measure.value(found) == pytest.approx(1.0 - 0.4 / 2)
    assert np.isnan(measure.value(found | {"train_goals": 49.0}))
    assert np.isnan(measure.value(found | {"held_out_agents": 0.0}))
