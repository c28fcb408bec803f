"""Poses on paths, and paths as actions."""

import math

import numpy as np
import pytest

from smarts.controllers.action_formats import PATH_POINTS
from smarts.controllers.trajectory_interpolation import TrajectoryInterpolation
from smarts.controllers.trajectory_tracking import TrajectoryTracking
from smarts.geometry.frames import wrap_angle
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


@pytest.mark.parametrize("speed", [0.5, 3.0, 20.0])
def test_without_times_headings_are_those_of_the_path(speed):
    """A vehicle on a circle of radius 5 m is turned inwards of its path; it brakes, and stands at the end."""
    angles = np.cumsum(np.append(0.0, np.linspace(speed, 0.0, 12)[:-1])) * 0.05
    angles = np.append(angles, [angles[-1]] * 3)
    tangents = 3.0 + angles
    path = np.zeros((1, len(angles), 5))
    path[0, :, 1:3] = 5.0 * np.column_stack([np.sin(tangents), -np.cos(tangents)])
    path[0, :, 3] = tangents - 0.27
    found = as_actions(path, PATH_POINTS, with_time=False)[0, 2]
    off = np.abs(wrap_angle(found[: len(tangents)] - tangents))
    # Chords are weighted by their lengths, not those of their arcs; at the end there is one only.
    assert off[:-4].max() < 2e-3
    assert off.max() < 0.03 * speed
    assert (found[len(tangents) :] == found[len(tangents) - 1]).all()
    np.testing.assert_array_equal(as_actions(path, PATH_POINTS)[0, 3, : len(tangents)], path[0, :, 3])


def test_a_path_that_stands_keeps_its_heading():
    path = np.zeros((2, 5, 5))
    path[0, :, 3], path[1] = 1.0, np.nan
    found = as_actions(path, 8, with_time=False)
    assert found[0, 2].tolist() == [1.0] * 8
    assert np.isnan(found[1]).all()
    assert as_actions(path[:, :1], 8, with_time=False)[0, 2].tolist() == [1.0] * 8
