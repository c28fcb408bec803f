"""Overlap of oriented boxes, against shapely and by hand."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity

from smarts.geometry.boxes import boxes_overlap

CAR = (5.0, 2.0)


@pytest.mark.parametrize(
    ("centre", "heading", "expected"),
    [
        ((4.9, 0.0), 0.0, True),
        ((5.0, 0.0), 0.0, False),
        ((0.0, 1.9), 0.0, True),
        ((0.0, 2.1), 0.0, False),
        ((3.4, 0.0), math.pi / 2, True),
        ((3.6, 0.0), math.pi / 2, False),
        ((0.0, 0.0), 1.0, True),
        # At 45 degrees a corner is 3.5 / sqrt(2) = 2.475 m behind and 1.5 / sqrt(2) = 1.061 m right of the
        # centre.
        ((2.5 + 2.47, 1.061), math.pi / 4, True),
        ((2.5 + 2.48, 1.061), math.pi / 4, False),
    ],
)
def test_by_hand(centre, heading, expected):
    assert boxes_overlap((0.0, 0.0), 0.0, CAR, centre, heading, CAR) == expected
    assert boxes_overlap(centre, heading, CAR, (0.0, 0.0), 0.0, CAR) == expected


def test_against_shapely():
    rng = np.random.Generator(np.random.Philox(1))
    count = 2000
    centre, centre2 = rng.uniform(-4, 4, (2, count, 2))
    heading, heading2 = rng.uniform(-4, 4, (2, count))
    size, size2 = rng.uniform(0.5, 8, (2, count, 2))

    def polygons(centre, heading, size):
        for (x, y), angle, (length, width) in zip(centre, heading, size, strict=True):
            box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
            yield shapely.affinity.translate(
                shapely.affinity.rotate(box, angle, (0, 0), use_radians=True), x, y
            )

    pairs = zip(polygons(centre, heading, size), polygons(centre2, heading2, size2), strict=True)
    expected = [one.intersection(other).area > 1e-9 for one, other in pairs]
    assert (boxes_overlap(centre, heading, size, centre2, heading2, size2) == expected).all()
    assert 0.2 < np.mean(expected) < 0.8


def test_all_pairs_by_broadcasting():
    centre = np.array([[0.0, 0.0], [4.0, 0.0], [20.0, 0.0]])
    overlap = boxes_overlap(centre[:, None], np.zeros((3, 1)), CAR, centre, np.zeros(3), CAR)
    assert overlap.tolist() == [[True, True, False], [True, True, False], [False, False, True]]
