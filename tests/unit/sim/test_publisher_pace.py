"""How often frames are sent."""

import numpy as np
import pytest

from smarts.sim.publisher_extras import PublishedExtras
from smarts.sim.publisher_pace import LONGEST, SHARE, SHORTEST, Pace


def play(cost, step, seconds=60.0):
    """Return at which times frames are sent of a simulation that steps so often."""
    pace, sent = Pace(), []
    for now in np.arange(0.0, seconds, step):
        if pace.is_due(now):
            pace.count(now, cost)
            sent.append(now)
    return np.array(sent)


@pytest.mark.parametrize("step", [0.01, 0.1])
def test_cheap_frames_are_sent_sixty_times_a_second_or_at_each_step(step):
    gaps = np.diff(play(1e-4, step))
    assert gaps.min() >= SHORTEST - 1e-9
    assert gaps.max() <= max(step, SHORTEST + step) + 1e-9


def test_dear_frames_take_no_more_than_their_share():
    sent = play(2e-3, 0.001)
    late = sent[sent > 10]
    assert 2e-3 / np.diff(late).mean() <= SHARE * 1.01
    assert np.diff(play(10.0, 0.001)).max() <= LONGEST + 0.002


def test_one_dear_frame_changes_little():
    pace = Pace()
    pace.count(0.0, 1e-4)
    pace.count(1.0, 5.0)
    assert pace.interval <= 1.2 * SHORTEST


def test_of_each_name_the_newest_annotation_is_kept_for_each_simulation():
    extras, steps = PublishedExtras(2), np.array([3, 4, 5])
    values, agents = np.arange(6.0).reshape(3, 2), np.array([[True, False], [True, True], [True, True]])
    extras.take("reward", values, agents, steps)
    # The caller's arrays are its own.
    values[:], agents[:], steps[:] = -1.0, True, 9
    only = np.array([[False, False], [False, True], [False, False]])
    extras.take("reward", np.full((3, 2), 7.0), only, np.array([0, 6, 0]))
    extras.take("nothing", values, np.zeros((3, 2), bool), steps)
    assert extras.pop(0) == [("reward", 3, [0], [[0.0]])]
    assert extras.pop(1) == [("reward", 6, [1], [[7.0]])]
    assert extras.pop(0) == extras.pop(1) == []
    extras.take("p", np.ones((3, 2, 2)), np.ones((3, 2), bool), steps)
    extras.forget(0)
    assert extras.pop(0) == []
    assert extras.pop(1) == [("p", 9, [0, 1], [[1.0, 1.0], [1.0, 1.0]])]
