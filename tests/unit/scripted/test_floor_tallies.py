"""Counting how agents of scripted policies end."""

import math
from collections import Counter

import pytest

from benchmark.scripted.play import Tally, wilson


def test_shares_are_of_agent_episodes():
    tally = Tally("keep_lane", "two_way", "none", agents=4)
    tally.add(Counter(goal=3, collision=1), 100.0)
    tally.add(Counter(goal=4), 140.0)
    assert tally.share("goal") == 7 / 8
    assert tally.share("collision") == 1 / 8
    assert tally.share("time_out") == 0.0
    assert tally.seconds == pytest.approx(12.0)


def test_without_episodes_shares_are_unknown():
    tally = Tally("keep_lane", "two_way", "none", agents=4)
    assert math.isnan(tally.share("goal"))
    assert wilson(0.5, 0) == (0.0, 1.0)


def test_wilson_is_that_of_the_textbook():
    # 8 of 10: (0.4902, 0.9433), as in Brown, Cai and DasGupta (2001) and R's binom.wilson.
    assert wilson(0.8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    # None of n: the upper bound is z^2 / (n + z^2).
    low, high = wilson(0.0, 40)
    assert low == 0.0
    assert high == pytest.approx(1.959964**2 / (40 + 1.959964**2))


def test_the_unit_of_an_interval_is_the_episode():
    tally = Tally("keep_lane", "two_way", "none", agents=4)
    for _ in range(10):
        tally.add(Counter(goal=4), 100.0)
    assert tally.interval("goal") == pytest.approx(wilson(1.0, 10))
