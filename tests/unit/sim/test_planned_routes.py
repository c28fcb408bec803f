"""Planned routes by number."""

import numpy as np
import pytest

from smarts.types.planned_routes import PlannedRoutes


def test_equal_routes_have_one_number_in_their_simulation():
    table = PlannedRoutes(2)
    assert [table.number(0, route) for route in ((4, 2), (7,), (4, 2), ())] == [0, 1, 0, -1]
    assert [table.number(1, route) for route in ((7,), (4, 2))] == [0, 1]
    assert (table.count(0), table.count(1)) == (2, 2)
    assert table.edges(0, 0).tolist() == [4, 2]
    assert table.edges(1, 0).tolist() == [7]


def test_routes_are_added_and_never_change():
    table = PlannedRoutes(1)
    table.number(0, [1, 2, 3])
    first = table.edges(0, 0)
    for number in range(100):
        table.number(0, [number])
    assert table.edges(0, 0) is first
    assert first.dtype == np.int32
    with pytest.raises(ValueError, match="read-only"):
        first[0] = 9


def test_reset_forgets_one_simulation():
    table = PlannedRoutes(2)
    for row in range(2):
        table.number(row, [row])
    table.reset(0)
    assert (table.count(0), table.count(1)) == (0, 1)
    assert table.number(0, [5]) == 0
