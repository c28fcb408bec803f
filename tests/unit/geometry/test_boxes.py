"""Overlap of oriented boxes, compared with shapely and with cases worked out by hand."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity

from smarts.geometry.boxes import boxes_overlap, may_meet

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


class TestMayMeet:
    """`may_meet`, compared with boxes that are moved in small steps."""

    def test_never_misses_a_contact(self):
        rng = np.random.Generator(np.random.Philox(2))
        count, seconds = 4000, 0.5
        moments = np.linspace(0.0, seconds, 26)
        centre = rng.uniform(-9, 9, (2, count, 2))
        heading = rng.uniform(-4, 4, (2, count))
        half = rng.uniform(0.3, 4, (2, count, 2))
        velocity = rng.normal(0, 8, (2, count, 2))
        turning = rng.normal(0, 0.5, (2, count))
        met = np.zeros(count, bool)
        for moment in moments:
            places = centre + moment * velocity, heading + moment * turning, 2 * half
            met |= boxes_overlap(*(part[0] for part in places), *(part[1] for part in places))
        may = np.array(
            [
                may_meet(
                    *(mover(centre, heading, half, velocity, turning, k, n) for k in (0, 1)), seconds, 0.0
                )
                for n in range(count)
            ]
        )
        assert (may | ~met).all()
        assert 0.2 < met.mean() < may.mean() < 0.8
        # For most pairs that do not meet, the answer is False.
        assert may[~met].mean() < 0.5

    @pytest.mark.parametrize(
        ("place", "velocity", "expected"),
        [
            ((8.0, 0.0), (-29.0, 0.0), False),  # 3 m apart, 2.9 m nearer in 0.1 s
            ((8.0, 0.0), (-31.0, 0.0), True),
            ((8.0, 0.0), (31.0, 0.0), False),
            ((2.0, 3.2), (-60.0, 0.0), False),  # in the next lane
            ((2.0, 3.2), (0.0, -13.0), True),
        ],
    )
    def test_by_hand(self, place, velocity, expected):
        one = (0.0, 0.0, 0.0), 2.5, 1.0, 0.0, 0.0, 0.0
        other = (*place, 0.0), 2.5, 1.0, *velocity, 0.0
        assert may_meet(one, other, 0.1, 0.0) == expected
        assert may_meet(other, one, 0.1, 0.0) == expected

    def test_slack_and_rotating_corners(self):
        one, other = ((0.0, 0.0, 0.0), 2.5, 1.0, 0.0, 0.0, 0.0), ((0.0, 2.3, 0.0), 2.5, 1.0, 0.0, 0.0)
        assert not may_meet(one, (*other, 0.0), 0.1, 0.29)
        assert may_meet(one, (*other, 0.0), 0.1, 0.31)
        # Corner to corner, 0.1 m apart.
        away = 1.0 + 0.1 / math.hypot(5.0, 2.0)
        diagonal = (5.0 * away, 2.0 * away, 0.0), 2.5, 1.0, 0.0, 0.0, 0.0
        assert not may_meet(one, diagonal, 0.1, 0.03)
        assert may_meet(one, diagonal, 0.1, 0.11)
        # The corner, 2.7 m from the centre, moves 0.27 m in 0.1 s at 1 rad/s.
        assert not may_meet(one, (*other, -1.0), 0.1, 0.02)
        assert may_meet(one, (*other, 1.2), 0.1, 0.0)


def mover(centre, heading, half, velocity, turning, which, number):
    pose = (*centre[which, number].tolist(), float(heading[which, number]))
    motion = (*velocity[which, number].tolist(), float(turning[which, number]))
    return pose, *half[which, number].tolist(), *motion
