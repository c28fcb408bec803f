"""The features `junction_ahead` and `crossing_traffic` at a crossing, by hand.

Lanes are 3.2 m wide; the lines are 10 m before the middle. The agent comes from the south in x = 1.6, so its
way overlaps that from the west in y = -1.6 from 6.8 m behind its line on, and there x is 0 to 3.2.
"""

import math

import numpy as np
import pytest

from smarts.observations.crossing_traffic import VALUES, VEHICLES
from smarts.observations.scales import SIGHT, SPEED_SCALE, expanded
from tests.maps import crossing
from tests.unit.observations.test_features import look
from tests.unit.roads.test_right_of_way import SOUTH_WAITS, TO_THE_NORTH, WEST_WAITS
from tests.worlds import Car, world_of


def seen_by(agent, *cars, maps=None, feature="crossing_traffic"):
    return look(world_of([agent, *cars], maps=maps or [crossing()]), features=[feature])[0, 0]


def from_the_south(y=-30.0, speed=8.0):
    return Car(1.6, y, math.pi / 2, speed, TO_THE_NORTH)


def from_the_west(x, speed=10.0, **more):
    return Car(x, -1.6, 0.0, speed, **more)


def rows_of(seen):
    """Return soonness, own distance, its distance [m], its speed [m/s], priority of each vehicle."""
    rows = seen.astype(float).reshape(VEHICLES, VALUES)
    rows[:, 1:3], rows[:, 3] = expanded(rows[:, 1:3], SIGHT), expanded(rows[:, 3], SPEED_SCALE)
    return rows


@pytest.mark.parametrize(
    ("y", "distance"),
    [(-30.0, 17.5), (-14.0, 1.5), (-11.0, 0.0), (0.0, 0.0), (30.0, SIGHT)],  # the front is 2.5 m ahead
)
def test_how_far_the_junction_is(y, distance):
    (seen,) = seen_by(from_the_south(y), feature="junction_ahead")
    assert expanded(seen, SIGHT) == pytest.approx(distance, abs=1e-3)


@pytest.mark.parametrize(("rules", "priority"), [(SOUTH_WAITS, 1), (WEST_WAITS, -1), (None, 0)])
def test_a_vehicle_that_comes_from_the_side(rules, priority):
    maps = [crossing(gives_way=rules)] if rules else None
    first, *others = rows_of(seen_by(from_the_south(), from_the_west(-40.0), maps=maps))
    np.testing.assert_allclose(first, [1 - 0.375, 24.3, 37.5, 10.0, priority], atol=0.02)
    assert not np.any(others)


def test_the_one_that_comes_first_is_first():
    slow, fast = from_the_west(-20.0, 2.5), Car(-1.6, 50.0, -math.pi / 2, 15.0, name="fast")
    rows = rows_of(seen_by(from_the_south(), slow, fast))
    assert rows[:2, 3] == pytest.approx([15.0, 2.5], abs=1e-3)
    assert not rows[2:].any()


def test_inside_the_junction():
    """Its front is 1.7 m past the overlap's begin, and the other vehicle stands in the overlap."""
    rows = rows_of(seen_by(from_the_south(-4.0), from_the_west(0.0, 0.0)))
    np.testing.assert_allclose(rows[0, :4], [1.0, -1.7, 0.0, 0.0], atol=0.02)


@pytest.mark.parametrize(
    "other",
    [
        from_the_west(6.0),  # its tail has left the overlap
        from_the_west(-40.0, 3.0),  # comes in 12 s
        Car(1.6, -40.0, math.pi / 2, 8.0),  # follows the agent
        Car(-1.6, -30.0, -math.pi / 2, 8.0),  # drives away
    ],
)
def test_vehicles_that_do_not_matter(other):
    assert not seen_by(from_the_south(), other).any()
