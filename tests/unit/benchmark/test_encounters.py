"""Who meets whom, who goes first, and how close it was."""

import math

import pytest

from benchmark.metrics.encounters import COLLIDED, FIRST, SECOND, UNRESOLVED, WAITING, find_encounters
from smarts.types.events import Outcome
from tests.measuring import CROSS, QUICKLY, SLOWLY, SOUTH_NORTH, WEST_EAST, meeting, sums, term, totals, value
from tests.recordings import LENGTH, Drive, across, at_speed, at_speeds, episode_of


class TestEncounters:
    def test_post_encroachment_time_is_from_the_rear_of_the_first_to_the_front_of_the_second(self, tmp_path):
        # The strip begins 89.6 m along the agent's way, and ends 90.4 m along the other's.
        found = find_encounters(meeting(tmp_path, SLOWLY, QUICKLY))
        other_leaves = (90.4 + LENGTH / 2 - 20.0) / 10.0
        agent_arrives = 6.0 + (89.6 - LENGTH / 2 - 55.0) / 10.0
        assert found.result.tolist() == [SECOND]
        assert found.gap_time == pytest.approx([agent_arrives - other_leaves], abs=0.15)

    def test_near_misses_are_unsafe_and_collisions_have_no_gap(self, tmp_path):
        near = meeting(tmp_path, [10.0] * 10 + [8.0] * 50 + [10.0] * 40, QUICKLY)
        wide = meeting(tmp_path, SLOWLY, QUICKLY)
        crash = meeting(tmp_path, [10.0] * 60, [10.0] * 60, outcome=Outcome.COLLISION, partner=1)
        assert term("safety", "post_encroachment_time", near) == 0.0
        assert term("safety", "post_encroachment_time", wide) == 1.0
        assert find_encounters(crash).result.tolist() == [COLLIDED]
        assert find_encounters(crash).gap_time.tolist() == [0.0]
        assert value("collaborative", crash, times=10) == 0.0
        assert math.isnan(value("collaborative", crash, times=9))

    def test_who_never_clears_the_crossing_has_not_given_way(self, tmp_path):
        stops = [10.0] * 10 + [5.0] * 40 + [0.0] * 150
        episode = meeting(tmp_path, stops, QUICKLY + [0.0] * 80, outcome=Outcome.TIME_OUT)
        found = totals(episode)
        assert found["unresolved_first"] == 1.0
        assert math.isnan(value("collaborative", episode, times=10))


def at_distances(folder, speed, distance, other_speed, other_distance):
    """Return half a second of two whose fronts are so far from the section that they contend for."""
    return meeting(
        folder,
        [speed] * 5,
        [other_speed] * 5,
        begin=89.75 - LENGTH / 2 - distance,
        other_begin=86.5 - LENGTH / 2 - other_distance,
    )


class TestOpening:
    @pytest.mark.parametrize(
        ("speed", "distance", "other_speed", "other_distance", "opens"),
        [
            pytest.param(5.0, 45.0, 5.0, 45.0, True, id="both arrive in 9 s"),
            # Half a second later it is still 10.5 s.
            pytest.param(5.0, 55.0, 5.0, 45.0, False, id="the agent in 11 s"),
            pytest.param(5.0, 45.0, 5.0, 55.0, False, id="the other in 11 s"),
            pytest.param(5.0, 20.0, 5.0, 34.0, True, id="the other 2.8 s later"),
            pytest.param(5.0, 20.0, 5.0, 36.0, False, id="the other 3.2 s later"),
            pytest.param(10.0, 60.0, 0.9, 6.0, False, id="the other at 0.9 m/s"),
            pytest.param(5.0, 0.5, 5.0, 5.0, True, id="the agent 0.5 m before it"),
            pytest.param(5.0, -0.5, 5.0, 5.0, False, id="the agent 0.5 m in it"),
            pytest.param(5.0, 5.0, 5.0, -0.5, False, id="the other 0.5 m in it"),
        ],
    )
    def test_who_meets(self, tmp_path, speed, distance, other_speed, other_distance, opens):
        episode = at_distances(tmp_path, speed, distance, other_speed, other_distance)
        assert len(find_encounters(episode).agent) == opens

    @pytest.mark.parametrize(
        ("lead", "is_first", "is_second"),
        [(0.1, False, False), (0.3, True, False), (-0.1, False, False), (-0.3, False, True)],
    )
    def test_which_one_is_predicted_first(self, tmp_path, lead, is_first, is_second):
        # The agent arrives in 4 s.
        found = find_encounters(at_distances(tmp_path, 5.0, 20.0, 10.0, 10.0 * (4.0 + lead)))
        assert found.lead == pytest.approx([lead])
        assert (found.is_predicted_first.tolist(), found.is_predicted_second.tolist()) == (
            [is_first],
            [is_second],
        )


FASTER = [10.0] * 5 + [16.0] * 80
"""Half a second as predicted, then 6 m/s faster."""
SECOND_TO_COME = dict(begin=20.0, other_begin=30.0)
"""The agent arrives in 6.775 s, the other in 5.45 s; without it in 5.775 s and 6.45 s."""


class TestOrder:
    """Which of the two went first, against the prediction."""

    @pytest.mark.parametrize(
        ("mine", "others", "counted"),
        [
            pytest.param(QUICKLY, QUICKLY, "kept_first", id="both as predicted"),
            pytest.param(SLOWLY, QUICKLY, "gave_way", id="the agent slows down"),
            # The other gains 2.2 s, the agent loses nothing.
            pytest.param(QUICKLY, FASTER, "lost_first", id="the other speeds up"),
            # At 9 m/s the agent loses 0.6 s of the 2.2 s.
            pytest.param([9.0] * 120, FASTER, "lost_first", id="the agent loses less than the other gains"),
            pytest.param(SLOWLY, FASTER, "gave_way", id="the agent loses more than the other gains"),
        ],
    )
    def test_of_an_agent_that_is_predicted_first(self, tmp_path, mine, others, counted):
        found = sums("collaborative", meeting(tmp_path, [10.0, *mine], [10.0, *others]))
        names = ("kept_first", "gave_way", "lost_first", "collided_first", "unresolved_first")
        assert {name: found[name] for name in names} == {name: float(name == counted) for name in names}
        contested = sums("competitive", meeting(tmp_path / "again", [10.0, *mine], [10.0, *others]))[
            "contested"
        ]
        assert contested == 0.0

    @pytest.mark.parametrize(
        ("mine", "others", "pushed"),
        [
            pytest.param(QUICKLY, QUICKLY, 0.0, id="both as predicted"),
            pytest.param(FASTER, QUICKLY, 1.0, id="the agent gains 2.4 s"),
            pytest.param(QUICKLY, SLOWLY, 0.0, id="the other loses 3.5 s"),
            pytest.param(FASTER, SLOWLY, 0.0, id="the other loses more than the agent gains"),
        ],
    )
    def test_of_an_agent_that_is_predicted_second(self, tmp_path, mine, others, pushed):
        episode = meeting(tmp_path, mine, others, **SECOND_TO_COME)
        found = sums("competitive", episode)
        assert (found["contested"], found["pushed_in"]) == (1.0, pushed)
        assert value("competitive", episode, times=10) == pushed
        assert math.isnan(value("competitive", episode, times=9))
        assert not any(sums("collaborative", episode).values())

    def test_exactly_one_of_two_agents_is_predicted_first(self, tmp_path):
        episode = episode_of(
            tmp_path,
            CROSS,
            Drive(across(CROSS, *WEST_EAST), at_speeds(SLOWLY, 30.0), agent="a", route=WEST_EAST),
            Drive(across(CROSS, *SOUTH_NORTH), at_speeds(QUICKLY, 20.0), agent="b", route=SOUTH_NORTH),
        )
        found = totals(episode)
        assert (found["gave_way"], found["gave_way_egos"], found["contested"]) == (1.0, 1.0, 1.0)
        assert found["pushed_in"] == 0.0
        assert term("collaborative", "encounters_with_egos", episode) == 1.0
        assert math.isnan(term("collaborative", "encounters_with_social_vehicles", episode))


class TestHowItEnds:
    @pytest.mark.parametrize(
        ("clears", "result", "counts"), [(21.0, SECOND, [1.0, 0.0]), (22.0, WAITING, [0.0, 1.0])]
    )
    def test_who_gives_way_clears_the_section_within_15_seconds(self, tmp_path, clears, result, counts):
        # The other enters after (86.5 - 2 - 20) m at 10 m/s, 6.45 s: until 21.5 s the agent may leave.
        # 95.5 m is where the agent's rear leaves it, 55.5 m after a first second at 10 m/s; the half metre
        # is driven well within the last step.
        slowly = (95.5 - 30.0 - 10.0 + 0.2) / (clears - 1.0)
        stays = QUICKLY + [0.0] * 120
        episode = meeting(tmp_path, [10.0] * 10 + [slowly] * 230, stays)
        assert find_encounters(episode).result.tolist() == [result]
        found = sums("collaborative", episode)
        assert [found["gave_way"], found["unresolved_first"]] == counts

    def test_an_encounter_in_which_neither_enters_within_15_seconds_is_unresolved(self, tmp_path):
        # Both stop before the section; the other goes after 16 s.
        late = [10.0] * 20 + [0.0] * 140 + [10.0] * 90
        stops = [10.0] * 20 + [0.0] * 230
        mine = meeting(tmp_path / "first", stops, late)
        assert find_encounters(mine).result.tolist() == [UNRESOLVED]
        assert sums("collaborative", mine)["unresolved_first"] == 1.0
        theirs = meeting(tmp_path / "second", stops, late, **SECOND_TO_COME)
        assert find_encounters(theirs).result.tolist() == [UNRESOLVED]
        assert sums("competitive", theirs)["contested"] == 0.0

    @pytest.mark.parametrize(("steps_apart", "safe"), [(9, 0.0), (10, 0.0), (11, 1.0)])
    @pytest.mark.parametrize("is_first", [False, True], ids=["the agent second", "the agent first"])
    def test_post_encroachment_time_above_a_second_is_safe(self, tmp_path, is_first, steps_apart, safe):
        # At 10 m/s, so a metre a step. Who is first has left with its rear, the second comes with its front;
        # half a metre off, lest rounding decide.
        enters, leaves = (86.5, 93.5) if is_first else (89.75, 90.25)
        first = leaves + LENGTH / 2 - 45.0 + 0.5
        second = enters - LENGTH / 2 - 45.0 - steps_apart + 0.5
        begin, other_begin = (first, second) if is_first else (second, first)
        episode = meeting(tmp_path, QUICKLY, QUICKLY, begin=begin, other_begin=other_begin)
        found = find_encounters(episode)
        assert found.result.tolist() == [FIRST if is_first else SECOND]
        assert found.gap_time == pytest.approx([steps_apart / 10])
        answer = sums("safety", episode)
        assert (answer["safe_gaps"], answer["timed_gaps"]) == (safe, 1.0)

    def test_who_comes_into_a_lane_from_another_meets_at_its_begin(self, tmp_path):
        # Both turn into the road to the east, whose begin is the section, a line.
        ways = across(CROSS, "north_in", "east_out"), across(CROSS, "west_in", "east_out")
        begins = [sum(CROSS.length[CROSS.lane_of_id(lane)] for lane in way[:2]) for way in ways]
        agent_arrives, other_leaves = 62, 41
        episode = episode_of(
            tmp_path,
            CROSS,
            Drive(
                ways[0],
                at_speed(10.0, 120, begins[0] - LENGTH / 2 - agent_arrives + 0.5),
                agent="a",
                route=("north_in", "east_out"),
            ),
            Drive(ways[1], at_speed(10.0, 120, begins[1] + LENGTH / 2 - other_leaves + 0.5), route=WEST_EAST),
        )
        found = find_encounters(episode)
        assert found.result.tolist() == [SECOND]
        assert found.gap_time == pytest.approx([2.1])
