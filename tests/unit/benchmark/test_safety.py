"""How near others came: times to collision, cut-ins, hard brakes."""

import math

import numpy as np
import pytest

from benchmark.metrics.collision_times import time_to_collision
from smarts.types.events import Outcome
from tests.measuring import CROSS, ROAD, WEST_EAST, following, meeting, sums, term, totals, value
from tests.recordings import DT, LENGTH, Drive, across, at_speed, episode_of


class TestTimeToCollision:
    def test_along_the_lane(self, tmp_path):
        # 20.5 m apart, bumper to bumper, closing at 10 m/s: they overlap at the first tenth after 2.05 s.
        times = time_to_collision(following(tmp_path, 0.0, speed=15.0, steps=10, gap=20.5))
        assert times[:, 0] == pytest.approx(2.1 - DT * np.arange(11))

    @pytest.mark.parametrize(
        ("other_begin", "expected"),
        [
            # Centres cross at 91.6 m and 88.4 m. Both at 10 m/s: footprints of 4 m x 1.8 m overlap while each
            # centre is less than 2.9 m from the crossing, so both from 2.87 s on at the latest.
            pytest.param(57.8, 2.8, id="both at once"),
            # The other comes 2 s later, when the agent has gone.
            pytest.param(37.8, math.inf, id="the agent has passed"),
        ],
    )
    def test_crossing_paths(self, tmp_path, other_begin, expected):
        crossing = meeting(
            tmp_path, [10.0] * 5, [10.0] * 5, begin=61.0, other_begin=other_begin, outcome=Outcome.NONE
        )
        assert time_to_collision(crossing)[0, 0] == pytest.approx(expected)

    def test_merging_paths(self, tmp_path):
        ways = across(CROSS, "north_in", "east_out"), across(CROSS, "west_in", "east_out")
        begins = [sum(CROSS.length[CROSS.lane_of_id(lane)] for lane in way[:2]) for way in ways]
        routes = ("north_in", "east_out"), WEST_EAST
        episode = episode_of(
            tmp_path,
            CROSS,
            Drive(ways[0], at_speed(10.0, 5, begins[0] - 15.0), agent="a", route=routes[0]),
            Drive(ways[1], at_speed(10.0, 5, begins[1] - 15.0), route=routes[1]),
        )
        # Both would be at the begin of the road to the east in 1.5 s.
        assert 0.0 < time_to_collision(episode)[0, 0] < 1.5

    def test_a_faster_follower_counts(self, tmp_path):
        episode = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(5.0, 2, 50.0), agent="a", route=["road"]),
            Drive(["road_0"], at_speed(15.0, 2, 50.0 - LENGTH - 19.5), route=["road"]),
        )
        assert time_to_collision(episode)[0, 0] == pytest.approx(2.0)

    @pytest.mark.parametrize(
        ("own", "lane", "other", "expected"),
        [
            pytest.param(-1.7, "road_0", 0.5, math.inf, id="beside its lane, straight on, 2.2 m past it"),
            pytest.param(-1.7, "road_0", 0.0, 2.0, id="beside its lane, straight on, 1.7 m aside"),
            pytest.param(0.0, "road_1", -1.3, math.inf, id="1.9 m from one in the lane beside"),
            pytest.param(0.0, "road_1", -1.5, 2.0, id="1.7 m from one that reaches in"),
        ],
    )
    def test_offsets_are_held(self, tmp_path, own, lane, other, expected):
        """Cars of 1.8 m in lanes of 3.2 m, 19.5 m apart, closing at 10 m/s."""
        episode = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(15.0, 2, 10.0), t=own, agent="a", route=["road"]),
            Drive([lane], at_speed(5.0, 2, 29.5 + LENGTH), t=other, route=["road"]),
        )
        assert time_to_collision(episode)[0, 0] == pytest.approx(expected)

    @pytest.mark.parametrize("t", [0.0, -2.0], ids=["along the lane", "straight on"])
    def test_speeds_of_oncoming_vehicles_add_up(self, tmp_path, t):
        episode = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(10.0, 2, 10.0), t=t, agent="a", route=["road"]),
            Drive(["road_0"], at_speed(-5.0, 2, 39.7 + LENGTH), t=t, is_oncoming=True, route=["road"]),
        )
        assert time_to_collision(episode)[0, 0] == pytest.approx(2.0)


class TestSafety:
    @pytest.mark.parametrize(("driven", "agents"), [(4.9, 0.0), (5.1, 1.0)])
    def test_an_agent_counts_that_drove_five_metres(self, tmp_path, driven, agents):
        episode = following(tmp_path, speed=driven, steps=10, outcome=Outcome.COLLISION)
        found = sums("safety", episode)
        assert (found["driven_agents"], found["driven_collisions"]) == (agents, agents)
        assert (found["timed_decisions"], found["safe_decisions"]) == (11.0 * agents, 11.0 * agents)
        assert value("safety", episode) == pytest.approx(0.5 if agents else math.nan, nan_ok=True)

    def test_share_of_decisions_and_terms_without_encounters(self, tmp_path):
        # 2.1 s at first, 0.1 s less each step: above 1.5 s at six of eleven instants.
        episode = following(tmp_path, 0.0, speed=15.0, steps=10, gap=20.5)
        assert term("safety", "time_to_collision", episode) == pytest.approx(6 / 11)
        assert math.isnan(term("safety", "post_encroachment_time", episode))
        assert value("safety", episode) == pytest.approx((1.0 + 6 / 11) / 2)


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


class TestHardBrakes:
    def caused(self, folder, decelerations, *, gap=10.0, driven=100.0, steps=100):
        """Return hard brakes and kilometres of an agent, before a vehicle that brakes at the steps given."""
        brakes = np.zeros(steps + 1)
        for step, deceleration in decelerations.items():
            brakes[step] = -deceleration
        episode = episode_of(
            folder,
            ROAD,
            Drive(["road_0"], at_speed(driven / steps / DT, steps, 200.0), agent="a", route=["road"]),
            Drive(
                ["road_0"], at_speed(10.0, steps, 200.0 - LENGTH - gap), acceleration=brakes, route=["road"]
            ),
        )
        found = sums("hard_brakes", episode)
        return found["hard_brakes"], found["kilometres"]

    @pytest.mark.parametrize(
        ("decelerations", "count"),
        [
            pytest.param({50: 3.9}, 0.0, id="3.9 m/s^2"),
            pytest.param({50: 4.1}, 1.0, id="4.1 m/s^2"),
            pytest.param({50: 5.0, 51: 5.0, 52: 5.0}, 1.0, id="one that takes a while"),
            pytest.param({50: 5.0, 61: 5.0}, 2.0, id="again after 1.1 s"),
        ],
    )
    def test_what_a_hard_brake_is(self, tmp_path, decelerations, count):
        assert self.caused(tmp_path, decelerations) == (count, pytest.approx(0.1))

    @pytest.mark.parametrize(("gap", "count"), [(32.0, 1.0), (33.0, 0.0)])
    def test_whoever_is_next_ahead_and_near_has_caused_it(self, tmp_path, gap, count):
        # At 10 m/s near is 2 s and the 12.5 m in which 4 m/s^2 make a stop.
        assert self.caused(tmp_path, {50: 5.0}, gap=gap)[0] == count

    @pytest.mark.parametrize(
        ("step", "count"), [(29, 1.0), (31, 0.0)], ids=["2.9 s after they met", "3.1 s after they met"]
    )
    def test_whoever_was_met_lately_has_caused_it(self, tmp_path, step, count):
        # They meet at first, and the agent is on a road of its own all the time.
        brakes = np.where(np.arange(41) == step, -5.0, 0.0)
        episode = meeting(tmp_path, [10.0] * 40, [10.0] * 40, acceleration=brakes)
        assert sums("hard_brakes", episode)["hard_brakes"] == count
