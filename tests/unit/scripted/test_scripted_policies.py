"""Scripted policies that are to do badly: blind to others, and creeping."""

import numpy as np
import pytest

from benchmark.scripted import SCRIPTED_POLICIES
from benchmark.scripted.gap_acceptance import CREEPING
from smarts.observations.lists import feature_list
from smarts.observations.neighbors import NEIGHBOR_VALUES
from smarts.observations.scales import RADIUS, SPEED_SCALE, compressed
from smarts.types.actions import LaneAction

ALL = np.ones(4, np.bool_)


def seen(speed, arrival=-1.0, standing_ahead=None):
    """Return what an agent of four observes on a straight road, perhaps with a standing vehicle ahead [m]."""
    layout = feature_list("benchmark").layout(4)
    found = np.zeros(max(place.stop for place in layout.values()), np.float32)
    found[layout["speed"]] = speed / SPEED_SCALE
    found[layout["arrival_order"]] = arrival
    found[layout["goal"]][0] = 0.9
    if standing_ahead is not None:
        row = found[layout["neighbors"]][:NEIGHBOR_VALUES]
        row[0], row[1], row[3] = 1.0, compressed(standing_ahead, RADIUS), compressed(-speed, SPEED_SCALE)
    return found


def act(policy, observation):
    chosen = SCRIPTED_POLICIES[policy]()
    chosen.begin(None, 0)
    return chosen.act(observation, ALL)


def test_the_rule_based_policy_brakes_for_a_standing_vehicle_and_the_blind_one_does_not():
    observation = seen(10.0, standing_ahead=12.0)
    before = observation.copy()
    assert act("gap_acceptance", observation) == LaneAction.slow_down
    assert act("empty_road", observation) == LaneAction.keep_lane
    np.testing.assert_array_equal(observation, before)
    assert act("gap_acceptance", seen(10.0)) == LaneAction.keep_lane


@pytest.mark.parametrize(
    ("speed", "action"), [(CREEPING - 0.1, LaneAction.keep_lane), (CREEPING + 0.1, LaneAction.slow_down)]
)
def test_creeping_is_driving_at_walking_speed(speed, action):
    assert act("creep", seen(speed)) == action
    assert act("gap_acceptance", seen(speed)) == LaneAction.keep_lane
