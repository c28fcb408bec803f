"""Counting how agents of scripted policies end."""

from collections import Counter

import pytest

from benchmark.scripted.play import Tally


def test_shares_are_of_agent_episodes():
    tally = Tally("keep_lane", "two_way", "none", agents=4)
    tally.add(Counter(goal=3, collision=1), 100.0)
    tally.add(Counter(goal=4), 140.0)
    assert tally.share("goal") == 7 / 8
    assert tally.share("collision") == 1 / 8
    assert tally.share("time_out") == 0.0
    assert tally.seconds == pytest.approx(12.0)


def test_the_unit_of_an_interval_is_the_episode():
    tally = Tally("keep_lane", "two_way", "none", agents=4)
    for _ in range(10):
        tally.add(Counter(goal=4), 100.0)
    assert tally.interval("goal") == pytest.approx((10 / (10 + 1.959964**2), 1.0))
