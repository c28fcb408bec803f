"""Means over episodes of several runners."""

import numpy as np

from algorithms.joint.metrics import EpisodeMean


def test_runners_count_by_their_episodes():
    one, other = EpisodeMean(is_leaf=True, is_root=False), EpisodeMean(is_leaf=True, is_root=False)
    one.push((6.0, 3))
    other.push((1.0, 1))
    other.push((3.0, 1))
    root = EpisodeMean(is_leaf=False, is_root=True)
    root.merge([one.reduce(compile=False), other.reduce(compile=False)])
    assert root.peek() == root.peek(latest_merged_only=True) == 22 / 5
    assert root.reduce() == 22 / 5
    assert np.isnan(root.reduce())
    assert np.isnan(one.peek())
