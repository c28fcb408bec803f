"""Social policies: which of those that are asked for are one policy of the run."""

import numpy as np

from smarts.agents.social import wanted

LOCATOR = "smarts.zoo:trajectory-v0"


def test_equal_options_are_one_policy():
    one = wanted(LOCATOR, {"poses": np.zeros((4, 3)), "speeds": [1, 2], "more": {"a": 1, "b": 2}})
    other = wanted(LOCATOR, {"more": {"b": 2, "a": 1}, "speeds": (1, 2), "poses": np.zeros((4, 3))})
    assert one == other
    assert one != one._replace(boid="boid-1")


def test_long_arrays_that_differ_in_the_middle_are_two_policies():
    poses = np.zeros((600, 3))
    changed = poses.copy()
    changed[300] = 1.0
    assert repr(poses) == repr(changed)
    assert wanted(LOCATOR, {"poses": poses}) != wanted(LOCATOR, {"poses": changed})
