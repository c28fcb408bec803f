import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smarts.stream.container import pack, unpack
from smarts.stream.motion import Motion, steps_message
from tests.compact_reading import motion_of


def random_rows(seed, vehicles=12, steps=40):
    """Return rows of vehicles that come and go, in any order, as SI units."""
    rng = np.random.default_rng(seed)
    there = rng.random((vehicles, steps)) < 0.8
    number, step = np.nonzero(there)
    order = rng.permutation(len(number))
    position = rng.uniform(0, 20_000, (len(number), 2))
    heading = rng.uniform(-math.pi, math.pi, len(number))
    speed, steer = rng.uniform(-5, 60, len(number)), rng.uniform(-0.6, 0.6, len(number))
    flags = rng.integers(0, 512, len(number))
    return tuple(each[order] for each in (number, step, position, heading, speed, steer, flags))


@settings(max_examples=30, deadline=None)
@given(compress=st.booleans(), seed=st.integers(0, 2**32), first=st.integers(0, 10**6))
def test_rows_come_back_within_half_a_unit(compress, seed, first):
    number, step, position, heading, speed, steer, flags = random_rows(seed)
    motion = Motion(number, step + first, *position.T, heading, speed, steer, flags)
    steps = np.arange(first, first + 40)
    found = motion_of(unpack(pack(steps_message(steps, motion, compress=compress))))
    order = np.lexsort((step, number))
    np.testing.assert_array_equal(found.number, number[order])
    np.testing.assert_array_equal(found.step, step[order] + first)
    np.testing.assert_array_equal(found.flags, flags[order])
    assert np.abs(np.stack([found.x, found.y], -1) / 100 - position[order]).max() <= 0.005 + 1e-9
    assert np.abs(found.speed / 100 - speed[order]).max() <= 0.005 + 1e-9
    off = np.radians(found.heading / 10) - heading[order]
    assert np.abs(np.remainder(off + math.pi, 2 * math.pi) - math.pi).max() <= math.radians(0.05) + 1e-9
    assert np.abs(np.radians(found.steer / 10) - steer[order]).max() <= math.radians(0.05) + 1e-9


def test_headings_are_unwrapped_within_a_run():
    heading = np.radians([170, 179, -172, -163, 178])
    zeros = np.zeros(5)
    steps = np.array([0, 1, 2, 3, 5])
    motion = Motion(zeros, steps, zeros, zeros, heading, zeros, zeros, zeros)
    found = motion_of(steps_message(np.arange(6), motion))
    # Step 4 is missing, so a new run begins at step 5.
    assert found.heading.tolist() == [1700, 1790, 1880, 1970, 1780]


@pytest.mark.parametrize("steps", [1, 3])
def test_what_is_not_finite_or_very_far_is_sent_as_numbers(steps):
    step = np.arange(steps)
    position = np.stack([np.full(steps, np.inf), np.full(steps, 1e12)], -1)
    numbers = [step * 0, step, *position.T, step + np.nan, step - np.inf, step * 0.0, step * 0]
    found = motion_of(unpack(pack(steps_message(step, Motion(*numbers)))))
    assert found.x.tolist() == found.heading.tolist() == found.speed.tolist() == [0] * steps
    assert (found.y > 1e9).all()
