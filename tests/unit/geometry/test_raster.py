"""Painting into rasters, checked cell by cell."""

import math

import numpy as np
import pytest

from smarts.geometry.raster import cut_view, near_blocks, paint_band, paint_box, paint_outline


def points(*places):
    return np.array(places, float)


def test_a_band_lies_beside_its_line_and_ends_with_it():
    cells = np.zeros((10, 20), np.uint8)
    paint_band(cells, 0.0, 0.0, 1.0, points((2, 5), (10, 5), (18, 5)), 0, 3, -2.0, 2.0, 0.0, 4)
    expected = np.zeros((10, 20), np.uint8)
    expected[3:7, 2:18] = 4
    assert (cells == expected).all()


def test_dashes():
    cells = np.zeros((3, 20), np.uint8)
    paint_band(cells, 0.0, 0.0, 1.0, points((0, 1.5), (7, 1.5), (20, 1.5)), 0, 3, -0.6, 0.6, 4.0, 1)
    assert cells[1].tolist() == [*[1] * 4, *[0] * 4, *[1] * 4, *[0] * 4, *[1] * 4]


def test_a_band_keeps_its_width_round_a_corner():
    cells = np.zeros((40, 40), np.uint8)
    corner = points((5, 10), (25, 10), (25, 35))
    paint_band(cells, 0.0, 0.0, 1.0, corner, 0, 3, -3.0, 3.0, 0.0, 1)
    y, x = np.mgrid[0.5:40, 0.5:40]
    along = (abs(y - 10) <= 3) & (x >= 5) & (x <= 25)
    up = (abs(x - 25) <= 3) & (y >= 10) & (y <= 35)
    outside = (x > 25) & (y < 10) & (np.hypot(x - 25, y - 10) <= 3)
    assert (cells == (along | up | outside)).all()


def test_an_outline_is_filled():
    cells = np.zeros((6, 6), np.uint8)
    triangle = points((9, 9), (1, 1), (5, 1), (1, 5))
    paint_outline(cells, 0.0, 0.0, 1.0, triangle, 1, 4, 1)
    # Centres on the slope itself, x + y = 6, may be inside or outside.
    y, x = np.mgrid[0.5:6, 0.5:6]
    assert (cells[x + y < 5.9] == ((x > 1) & (y > 1))[x + y < 5.9]).all()
    assert not cells[x + y > 6.1].any()
    paint_outline(cells, 0.0, 0.0, 1.0, triangle, 2, 2, 7)
    assert cells.max() == 1


def test_boxes_out_of_view_or_not_finite_are_skipped():
    view = np.zeros((8, 8, 1), np.uint8)
    colour = np.ones(1, np.uint8)
    for place in (math.nan, math.inf, 1e300, 40.0):
        paint_box(view, 1.0, place, 0.0, 0.0, 4.0, 2.0, colour)
        paint_box(view, 1.0, 0.0, -place, 0.0, 4.0, 2.0, colour)
    assert not view.any()
    paint_box(view, 1.0, 0.0, 0.0, 0.0, 4.0, 2.0, colour)
    assert view.sum() == 8


@pytest.mark.parametrize("channels", [1, 3])
def test_a_view_shows_the_cell_at_the_centre_of_each_pixel(channels):
    generator = np.random.Generator(np.random.Philox(1))
    cells = generator.integers(0, 16, (30, 40)).astype(np.uint8)
    colours = generator.integers(0, 256, (16, channels)).astype(np.uint8)
    near, view = near_blocks(cells), np.zeros((24, 20, channels), np.uint8)
    for _ in range(20):
        x, y, heading = *generator.uniform(-2.0, 22.0, 2), generator.uniform(-math.pi, math.pi)
        cut_view(cells.ravel(), 30, 40, 0.0, 0.0, 0.5, near, x, y, heading, 0.7, colours, view)
        ahead = (12 - np.arange(24) - 0.5)[:, None] * 0.7
        left = (10 - np.arange(20) - 0.5)[None, :] * 0.7
        column = np.floor((x + ahead * math.cos(heading) - left * math.sin(heading)) / 0.5).astype(int)
        row = np.floor((y + ahead * math.sin(heading) + left * math.cos(heading)) / 0.5).astype(int)
        inside = (row >= 0) & (row < 30) & (column >= 0) & (column < 40)
        shown = np.where(inside, cells[np.clip(row, 0, 29), np.clip(column, 0, 39)], 0)
        assert (view == colours[shown]).mean() > 0.99  # centres on the edges of cells may go either way


@pytest.mark.parametrize("resolution", [0.05, 0.41])
def test_tiles_without_anything_near_change_nothing(resolution):
    generator = np.random.Generator(np.random.Philox(3))
    cells, full = np.zeros((90, 70), np.uint8), np.ones((14, 11), np.uint8)
    rows, columns = generator.integers(0, 90, 12), generator.integers(0, 70, 12)
    cells[rows, columns] = generator.integers(1, 16, 12)
    colours = generator.integers(0, 256, (16, 1)).astype(np.uint8)
    raster, shown = (cells.ravel(), 90, 70, -4.0, 3.0, 0.2), 0
    for _ in range(40):
        near_to = generator.integers(12)
        x, y = -4.0 + 0.2 * columns[near_to], 3.0 + 0.2 * rows[near_to]
        aside, heading = generator.uniform(-1.0, 1.0, 2), generator.uniform(-math.pi, math.pi)
        place = x + aside[0], y + aside[1], heading, resolution
        quick, plain = np.zeros((33, 50, 1), np.uint8), np.zeros((33, 50, 1), np.uint8)
        cut_view(*raster, near_blocks(cells), *place, colours, quick)
        cut_view(*raster, full, *place, colours, plain)
        np.testing.assert_array_equal(quick, plain)
        shown += (quick != colours[0]).any()
    assert shown > 5


def test_a_box_covers_the_pixels_whose_centres_lie_in_it():
    generator = np.random.Generator(np.random.Philox(2))
    for _ in range(50):
        view = np.zeros((24, 30, 1), np.uint8)
        ahead, aside, turn = *generator.uniform(-10, 10, 2), generator.uniform(-7, 7)
        paint_box(view, 0.5, ahead, aside, turn, 5.0, 1.8, np.ones(1, np.uint8))
        forward = (12 - np.arange(24) - 0.5)[:, None] * 0.5 - ahead
        left = (15 - np.arange(30) - 0.5)[None, :] * 0.5 - aside
        along = np.abs(forward * math.cos(turn) + left * math.sin(turn))
        across = np.abs(left * math.cos(turn) - forward * math.sin(turn))
        assert (view[..., 0] == ((along <= 2.5) & (across <= 0.9))).all()
