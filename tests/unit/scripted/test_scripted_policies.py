"""Scripted policies: the rule-based one behind leaders, and those that are to do badly."""

import numpy as np
import pytest

from benchmark.scripted import SCRIPTED_POLICIES
from benchmark.scripted.gap_acceptance import CREEPING
from smarts.observations.lists import feature_list
from smarts.observations.neighbors import NEIGHBOR_VALUES
from smarts.observations.scales import RADIUS, SPEED_SCALE, compressed
from smarts.types.actions import LaneAction

ALL = np.ones(4, np.bool_)


def seen(speed, arrival=-1.0, ahead=None, leaders_speed=0.0):
    """Return what an agent of four observes on a straight road, perhaps with a leader ahead [m], [m/s]."""
    layout = feature_list("benchmark").layout(4)
    found = np.zeros(max(place.stop for place in layout.values()), np.float32)
    found[layout["speed"]] = speed / SPEED_SCALE
    found[layout["arrival_order"]] = arrival
    found[layout["goal"]][0] = 0.9
    if ahead is not None:
        row = found[layout["neighbors"]][:NEIGHBOR_VALUES]
        row[0], row[1], row[3] = (
            1.0,
            compressed(ahead, RADIUS),
            compressed(leaders_speed - speed, SPEED_SCALE),
        )
    return found


def act(policy, observation):
    chosen = SCRIPTED_POLICIES[policy]()
    chosen.begin(None, 0)
    return chosen.act(observation, ALL)


def test_the_rule_based_policy_brakes_for_a_standing_vehicle_and_the_blind_one_does_not():
    observation = seen(10.0, ahead=12.0)
    before = observation.copy()
    assert act("gap_acceptance", observation) == LaneAction.slow_down
    assert act("empty_road", observation) == LaneAction.keep_lane
    np.testing.assert_array_equal(observation, before)
    assert act("gap_acceptance", seen(10.0)) == LaneAction.keep_lane


@pytest.mark.parametrize(
    # At 6 m/s the vehicle gains speed for 0.5 s (3.3 m, 7.25 m/s) and stops after another 10.5 m; a leader of
    # 6 m/s stops after 4 m. 6.2 m from centre to centre remain: 16 m are needed, behind a standing one 20 m.
    ("ahead", "speed", "action"),
    [
        (16.4, 6.0, LaneAction.keep_lane),
        (15.6, 6.0, LaneAction.slow_down),
        (20.4, 0.0, LaneAction.keep_lane),
        (19.6, 0.0, LaneAction.slow_down),
    ],
)
def test_the_distance_to_a_leader_is_that_in_which_it_can_stop(ahead, speed, action):
    assert act("gap_acceptance", seen(6.0, ahead=ahead, leaders_speed=speed)) == action


@pytest.mark.parametrize("leaders_speed", [4.0, 6.0, 8.0])
@pytest.mark.parametrize("braking", [2.0, 4.5])
def test_it_follows_within_two_seconds_and_never_touches_a_leader_that_brakes(leaders_speed, braking):
    own, speed, leader, dt = 0.0, 5.0, 25.0, 0.1
    headways, gaps, action = [], [], LaneAction.keep_lane
    for step in range(600):
        if step % 5 == 0:
            action = act("gap_acceptance", seen(speed, ahead=leader - own, leaders_speed=leaders_speed))
        speed = max(0.0, speed + dt * (2.5 if action == LaneAction.keep_lane else -2.5))
        leaders_speed -= dt * braking if step > 400 else 0.0
        own, leader = own + dt * speed, leader + dt * max(0.0, leaders_speed)
        gaps.append(leader - own - 5.0)
        headways.append(gaps[-1] / speed if 250 < step < 400 else np.nan)
        leaders_speed = max(0.0, leaders_speed)
    assert min(gaps) > 0.0
    assert np.nanmin(headways) < 2.0
    assert gaps[-1] < 10.0


@pytest.mark.parametrize(
    ("speed", "action"), [(CREEPING - 0.1, LaneAction.keep_lane), (CREEPING + 0.1, LaneAction.slow_down)]
)
def test_creeping_is_driving_at_walking_speed(speed, action):
    assert act("creep", seen(speed)) == action
    assert act("gap_acceptance", seen(speed)) == LaneAction.keep_lane
