"""What algorithms say, until the next frame takes it along."""

import numpy as np

from smarts.sim.publisher_extras import PublishedExtras


def test_of_each_name_the_newest_annotation_is_kept_for_each_simulation():
    extras, steps = PublishedExtras(2), np.array([3, 4, 5])
    values, agents = np.arange(6.0).reshape(3, 2), np.array([[True, False], [True, True], [True, True]])
    extras.take("reward", values, agents, steps)
    # The caller's arrays are its own.
    values[:], agents[:], steps[:] = -1.0, True, 9
    only = np.array([[False, False], [False, True], [False, False]])
    extras.take("reward", np.full((3, 2), 7.0), only, np.array([0, 6, 0]))
    extras.take("nothing", values, np.zeros((3, 2), bool), steps)
    assert extras.pop(0) == [(3, 0, "reward", [0.0])]
    assert extras.pop(1) == [(6, 1, "reward", [7.0])]
    assert extras.pop(0) == extras.pop(1) == []
    extras.take("p", np.ones((3, 2, 2)), np.ones((3, 2), bool), steps)
    assert extras.pop(1) == [(9, 0, "p", [1.0, 1.0]), (9, 1, "p", [1.0, 1.0])]
