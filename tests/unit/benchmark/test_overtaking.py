"""Who could have been overtaken, and who was."""

import numpy as np
import pytest

from tests.measuring import following, sums
from tests.recordings import LENGTH, at_speed, straight


def opportunities(episode):
    return sums("competitive", episode)["opportunities"]


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        pytest.param({"gap": 29.0}, 1.0, id="29 m behind"),
        pytest.param({"gap": 31.0}, 0.0, id="31 m behind"),
        pytest.param({"steps": 10}, 1.0, id="for 1.0 s"),
        pytest.param({"steps": 9}, 0.0, id="for 0.9 s"),
        pytest.param({"desired_speed": 6.1}, 1.0, id="wants 1.1 m/s more"),
        pytest.param({"graph": straight(lanes=2), "lane": "road_1"}, 1.0, id="a lane to the right"),
        pytest.param({"graph": straight(lanes=1)}, 0.0, id="no lane beside"),
    ],
)
def test_what_an_opportunity_is(tmp_path, changes, found):
    """An agent that follows at its leader's 5 m/s, and wants 13 m/s."""
    assert opportunities(following(tmp_path, **{"speed": 5.0, "steps": 20, **changes})) == found


@pytest.mark.parametrize(("is_oncoming", "found"), [(False, 1.0), (True, 0.0)])
def test_who_comes_towards_one_is_nobody_to_overtake(tmp_path, is_oncoming, found):
    way = at_speed(-5.0 if is_oncoming else 5.0, 20, 40.0)
    episode = following(tmp_path, speed=5.0, steps=20, leader={"s": way, "is_oncoming": is_oncoming})
    assert opportunities(episode) == found


def test_a_leader_is_one_opportunity_however_often_it_is_near(tmp_path):
    # 20 m, 40 m and 20 m away, for 2 s each.
    gaps = 20.0 + 20.0 * ((np.arange(61) >= 20) & (np.arange(61) < 40))
    leader = {"s": at_speed(5.0, 60, 10.0 + LENGTH) + gaps}
    assert opportunities(following(tmp_path, speed=5.0, steps=60, leader=leader)) == 1.0


@pytest.mark.parametrize(("by", "overtakes"), [(-0.1, 0.0), (0.1, 1.0)])
def test_passed_is_who_is_a_bumper_behind(tmp_path, by, overtakes):
    # 10 m/s in the lane to the left from 2 s on; after 10 s the rears are so far before the other's front.
    moves_out = np.where(np.arange(101) < 20, 0.0, 3.2)
    ends = np.interp(np.arange(101), [0, 20, 100], [10.0, 20.0, 84.0 + LENGTH + by])
    episode = following(tmp_path, moves_out, steps=100, s=ends)
    found = sums("competitive", episode)
    assert (found["opportunities"], found["overtakes"]) == (1.0, overtakes)
