"""The feature `neighbor_rows`: by hand, and against the features whose numbers it has."""

import math

import numpy as np
import pytest

from smarts.observations.neighbor_rows import COLUMNS
from smarts.observations.neighbors import NEIGHBORS
from smarts.observations.scales import RADIUS, SIGHT, SPEED_SCALE, expanded
from tests.maps import crossing, straight
from tests.unit.observations.test_features import look, mission, observation_of, observe
from tests.unit.observations.test_junctions import from_the_south, from_the_west
from tests.unit.roads.test_right_of_way import SOUTH_WAITS
from tests.worlds import Car, world_of


def rows_of(*cars, maps=None):
    made = world_of([*cars], maps=maps or [straight()])
    seen = observe(observation_of(made, features=["speed", "neighbor_rows"]))["neighbor_rows"]
    assert seen.shape == (1, 1, NEIGHBORS, len(COLUMNS))
    assert np.all(np.abs(seen) <= 1.0)
    return seen[0, 0].astype(float)


def test_a_row_by_hand():
    """The agent drives north at 10 m/s; the vehicle 12 m ahead, 9 m to the right, drives west at 5 m/s."""
    agent = Car(50.0, 0.0, math.pi / 2, 10.0, mission=mission("road"))
    first, *others = rows_of(agent, Car(59.0, 12.0, math.pi, 5.0))
    assert first[0] == pytest.approx(1 - 15 / 50)
    np.testing.assert_allclose(expanded(first[1:3], RADIUS), [12.0, -9.0], rtol=1e-4)
    np.testing.assert_allclose(expanded(first[3:5], SPEED_SCALE), [-10.0, 5.0], rtol=1e-4)
    np.testing.assert_allclose(first[5:9], [12 / 15, -9 / 15, 0.0, 1.0], atol=1e-6)
    # Closing speed 10 * 12/15 + 5 * 9/15 = 11 m/s over 15 m.
    assert first[9] == pytest.approx(1 - 15 / 11 / 5)
    assert not first[10:].any()
    assert not np.any(others)


def test_rows_have_the_numbers_of_other_features():
    cars = [from_the_south(), from_the_west(-36.0), from_the_west(-20.0, speed=4.0)]
    maps = [crossing(gives_way=SOUTH_WAITS)]
    rows = rows_of(*cars, maps=maps)
    alone = look(world_of(cars, maps=maps), features=["neighbors"])[0, 0].reshape(NEIGHBORS, -1)
    np.testing.assert_allclose(rows[:, :5], alone, atol=1e-6)
    crossing_cars = look(world_of(cars, maps=maps), features=["crossing_traffic"])[0, 0].reshape(4, 5)
    by_soonness = rows[np.argsort(-rows[:, 10])][:4]
    np.testing.assert_allclose(by_soonness[:, 10], crossing_cars[:, 0], atol=1e-6)
    np.testing.assert_allclose(by_soonness[:, 11:], crossing_cars[:, [1, 4]], atol=1e-6)
    assert expanded(by_soonness[0, 11], SIGHT) == pytest.approx(24.3, abs=0.02)
    assert by_soonness[0, 12] == 1.0
    sectors = look(world_of(cars, maps=maps), features=["neighbor_sectors"])[0, 0].reshape(8, 5)
    urgencies = sectors[sectors[:, 0] > 0.0][:, 2]
    assert len(urgencies)
    assert np.abs(urgencies[:, None] - rows[:, 9]).min(axis=1).max() < 1e-5


def test_rows_radius_and_columns_are_chosen():
    cars = [Car(50.0, 0.0, 0.3, 5.0, mission=mission("road")), Car(65.0, 3.0, 1.0), Car(120.0, 6.0, 0.2, 9.0)]
    made = world_of(cars, maps=[straight()])
    options = {"rows": 3, "radius": 80.0, "columns": ["urgency", "nearness", "left"]}
    seen = observe(observation_of(made, features=["speed", {"neighbor_rows": options}]))["neighbor_rows"][
        0, 0
    ]
    assert seen.shape == (3, 3)
    np.testing.assert_allclose(1 - seen[:2, 1], np.hypot([15, 70], [3, 6]) / 80.0, rtol=1e-6)
    assert not seen[2].any()
    default = rows_of(*cars)
    assert seen[0, 0] == pytest.approx(default[0, COLUMNS.index("urgency")])
    lefts = [expanded(seen[0, 2], 80.0), expanded(default[0, COLUMNS.index("left")], RADIUS)]
    assert lefts[0] == pytest.approx(lefts[1], rel=1e-5)
