"""Painting into pictures, cell by cell."""

import math

import numpy as np
import pytest

from smarts.geometry.raster import cut_view, paint_band, paint_box, paint_outline, place_in_view


def points(*places):
    return np.array(places, float)


def test_a_band_lies_beside_its_line_and_ends_with_it():
    cells = np.zeros((10, 20), np.uint8)
    paint_band(cells, 0.0, 0.0, 1.0, points((2, 5), (10, 5), (18, 5)), 0, 3, -2.0, 2.0, 0.0, 4)
    expected = np.zeros((10, 20), np.uint8)
    expected[3:7, 2:18] = 4
    assert (cells == expected).all()


def test_a_band_to_the_left_and_bits_of_before():
    cells = np.ones((10, 20), np.uint8)
    paint_band(cells, 0.0, 0.0, 1.0, points((2, 5), (18, 5)), 0, 2, 1.0, 2.0, 0.0, 2)
    assert (cells[6, 2:18] == 3).all()
    assert (cells == 3).sum() == 16


def test_dashes():
    cells = np.zeros((3, 20), np.uint8)
    paint_band(cells, 0.0, 0.0, 1.0, points((0, 1.5), (7, 1.5), (20, 1.5)), 0, 3, -0.6, 0.6, 4.0, 1)
    assert cells[1].tolist() == [*[1] * 4, *[0] * 4, *[1] * 4, *[0] * 4, *[1] * 4]


def test_a_band_goes_round_the_bend_and_keeps_its_width():
    cells = np.zeros((40, 40), np.uint8)
    corner = points((5, 10), (25, 10), (25, 35))
    paint_band(cells, 0.0, 0.0, 1.0, corner, 0, 3, -3.0, 3.0, 0.0, 1)
    y, x = np.mgrid[0.5:40, 0.5:40]
    along = (abs(y - 10) <= 3) & (x >= 5) & (x <= 25)
    up = (abs(x - 25) <= 3) & (y >= 10) & (y <= 35)
    outside = (x > 25) & (y < 10) & (np.hypot(x - 25, y - 10) <= 3)
    assert (cells == (along | up | outside)).all()


def test_bands_beyond_the_picture_are_left_out():
    cells = np.zeros((4, 4), np.uint8)
    paint_band(cells, 0.0, 0.0, 1.0, points((-9, -9), (-5, -5)), 0, 2, -1.0, 1.0, 0.0, 1)
    assert not cells.any()


def test_an_outline_is_filled():
    cells = np.zeros((6, 6), np.uint8)
    triangle = points((9, 9), (1, 1), (5, 1), (1, 5))
    paint_outline(cells, 0.0, 0.0, 1.0, triangle, 1, 4, 1)
    # Centres on the slope itself, x + y = 6, belong to neither side for certain.
    y, x = np.mgrid[0.5:6, 0.5:6]
    assert (cells[x + y < 5.9] == ((x > 1) & (y > 1))[x + y < 5.9]).all()
    assert not cells[x + y > 6.1].any()
    paint_outline(cells, 0.0, 0.0, 1.0, triangle, 2, 2, 7)
    assert cells.max() == 1


def test_places_as_a_viewer_sees_them():
    ahead, left = place_in_view(10.0, 23.0, 10.0, 20.0, math.pi / 2)
    assert (ahead, left) == pytest.approx((3.0, 0.0))
    ahead, left = place_in_view(9.0, 20.0, 10.0, 20.0, math.pi / 2)
    assert (ahead, left) == pytest.approx((0.0, 1.0))


def test_boxes_that_cannot_be_painted():
    view = np.zeros((8, 8, 1), np.uint8)
    colour = np.ones(1, np.uint8)
    for place in (math.nan, math.inf, 1e300, 40.0):
        paint_box(view, 1.0, place, 0.0, 0.0, 4.0, 2.0, colour)
        paint_box(view, 1.0, 0.0, -place, 0.0, 4.0, 2.0, colour)
    assert not view.any()
    paint_box(view, 1.0, 0.0, 0.0, 0.0, 4.0, 2.0, colour)
    assert view.sum() == 8


def test_a_view_is_cut_out_as_the_viewer_is_turned():
    cells = np.arange(100, dtype=np.uint8)
    view = np.zeros((4, 2), np.uint8)
    picture = cells.reshape(10, 10)
    cut_view(cells, 0, 10, 10, 100.0, 50.0, 1.0, 105.0, 55.0, math.pi / 2, 1.0, 255, view)
    # North is up: rows from the south are turned about.
    assert (view == picture[3:7, 4:6][::-1]).all()
    cut_view(cells, 0, 10, 10, 100.0, 50.0, 1.0, 105.0, 55.0, 0.0, 1.0, 255, view)
    assert (view == picture[4:6, 3:7].T[::-1, ::-1]).all()
    cut_view(cells, 0, 10, 10, 100.0, 50.0, 1.0, 1e7, -1e7, 0.0, 1.0, 255, view)
    assert not view.any()
