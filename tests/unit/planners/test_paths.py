"""Poses on paths, and paths as actions."""

import math

import numpy as np

from smarts.controllers.action_formats import PATH_POINTS
from smarts.controllers.trajectory_interpolation import TrajectoryInterpolation
from smarts.controllers.trajectory_tracking import TrajectoryTracking
from smarts.planners import as_actions, resample

PATH = np.array([[[0.0, 0, 0, 0, 4], [1, 4, 2, math.pi / 2, 2]]])


def test_poses_between_and_beyond_the_rows():
    found = resample(PATH, np.array([[-1.0, 0.5, 1.0, 3.0]]))
    expected = [
        [-1, 0, 0, 0, 4],
        [0.5, 2, 1, math.pi / 4, 3],
        [1, 4, 2, math.pi / 2, 2],
        [3, 4, 6, math.pi / 2, 2],
    ]
    np.testing.assert_allclose(found[0], expected, atol=1e-12)


def test_one_row_is_a_drive_at_constant_velocity():
    found = resample(np.array([[[0.0, 1, 1, math.pi, 3]]]), np.array([[0.0, 2.0]]))
    np.testing.assert_allclose(found[0, :, 1:3], [[1, 1], [-5, 1]], atol=1e-12)


def test_the_shorter_turn_is_taken_across_the_back():
    path = np.array([[[0.0, 0, 0, 3.0, 1], [1, 0, 0, -3.0, 1]]])
    heading = resample(path, np.array([[0.5]]))[0, 0, 3]
    assert abs(math.remainder(heading - math.pi, 2 * math.pi)) < 1e-12


def test_actions_of_both_path_types_are_accepted():
    with_time = as_actions(PATH, PATH_POINTS)
    without = as_actions(PATH, PATH_POINTS, with_time=False)
    for actions, controller in ((with_time, TrajectoryInterpolation), (without, TrajectoryTracking)):
        parsed = controller.action_format.parse_batch(actions)
        np.testing.assert_array_equal(parsed, actions)
        assert actions[0].shape == controller.action_format.space().shape
    np.testing.assert_array_equal(with_time[0, :, 1:], np.repeat(PATH[0, 1:].T, 31, axis=1))
