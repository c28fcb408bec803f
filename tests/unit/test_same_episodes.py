"""What `python perf/same_episodes.py` reads out of values, and how it names a difference."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from perf.same_episodes import difference, digest, texts


class Point(NamedTuple):
    x: float
    name: str = "a"
    missing: float | None = None


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1.0, math.nextafter(1.0, 2.0)),
        ([0.0], [-0.0]),
        (np.zeros(2, np.float32), np.zeros(2)),
        (np.zeros((1, 2)), np.zeros((2, 1))),
        ([], None),
        ([Point(1.0), Point(2.0)], [Point(2.0), Point(1.0)]),
    ],
)
def test_bits_types_and_shapes_are_seen(one, other):
    assert digest("it", one) != digest("it", other)


def test_a_difference_names_the_first_item_that_differs_and_both_values():
    (_, one), (_, other) = (*texts("it", np.array([1.0, 2.0])), *texts("it", np.array([1.0, -2.0])))
    assert difference(one, other) == "1 of 2 differ, [1] 2.0 -> -2.0"
    assert difference(one, []) == "float64 (2,) -> absent"
