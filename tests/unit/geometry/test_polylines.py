import math

import numpy as np
import pytest

from smarts.geometry import polylines

CORNER = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 2.5]])


def test_subdivide_keeps_vertices_and_length():
    fine = polylines.subdivide(CORNER, 1.0)
    assert len(fine) == 10 + 3 + 1
    assert polylines.arc_lengths(fine)[-1] == pytest.approx(12.5)
    for vertex in CORNER:
        assert (fine == vertex).all(axis=1).any()
    steps = np.diff(polylines.arc_lengths(fine))
    np.testing.assert_allclose(steps[:10], 1.0)
    np.testing.assert_allclose(steps[10:], 2.5 / 3)


def test_headings_of_a_corner():
    np.testing.assert_allclose(polylines.headings(CORNER), [0, math.pi / 4, math.pi / 2])


def test_headings_across_west_do_not_pass_through_east():
    line = np.array([[0.0, 0.0], [-1.0, 0.1], [-2.0, 0.0]])
    assert abs(polylines.headings(line)[1]) == pytest.approx(math.pi)


def test_headings_where_the_line_reverses():
    np.testing.assert_allclose(polylines.headings(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]))[1], math.pi)


def test_without_repeats():
    points = np.array([[0.0, 0.0], [0.0, 1e-9], [1.0, 0.0], [1.0, 0.0]])
    np.testing.assert_array_equal(polylines.without_repeats(points), [[0, 0], [1, 0]])
