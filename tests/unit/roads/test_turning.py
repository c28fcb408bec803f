"""Places to turn round, on maps made by hand."""

import numpy as np
import pytest

from smarts.roads.atlas import RoadAtlas
from smarts.roads.curves import curve_into
from smarts.roads.turning import can_turn_round, is_footprint_over_road, is_over_road
from tests.maps import Road, graph_of


@pytest.mark.parametrize(
    ("middle", "begin", "can"),
    [
        ((0, 200), 0.0, True),
        ((60, 61), 0.0, False),  # too short a break in the median
        ((60, 75), 0.0, True),
        ((60, 75), 72.0, False),  # behind it
    ],
)
def test_turns_are_over_road_all_the_way(middle, begin, can):
    graph = graph_of(
        {
            "there": Road([(0, 0), (200, 0)], 3),
            "back": Road([(200, 12.8), (0, 12.8)]),
            "middle": Road([(x, 9.6) for x in middle]),
        }
    )
    assert can_turn_round(RoadAtlas([graph]).roads, 0, 0, 3, begin) is can


def test_a_road_of_the_same_direction_is_none_to_turn_into():
    roads = {"there": Road([(0, 0), (200, 0)], 3), "along": Road([(0, 9.6), (200, 9.6)])}
    assert not can_turn_round(RoadAtlas([graph_of(roads)]).roads, 0, 0, 3, 0.0)


@pytest.mark.parametrize(("lanes", "fits"), [(3, True), (1, False)])
def test_the_whole_footprint_has_to_be_over_road(lanes, fits):
    """From the rightmost lane it turns by a half circle of radius 4.8 or 1.6 m; the road ends 1.6 m beyond.

    The outer front corner is at hypot(4.8 + 0.9, 2.25) = 6.1 m, or 3.4 m, from the middle.
    """
    back = 3.2 * lanes
    graph = graph_of({"there": Road([(0, 0), (200, 0)], lanes), "back": Road([(200, back), (0, back)])})
    roads = RoadAtlas([graph]).roads
    control = curve_into(roads, np.array([100.0, 0.0, 0.0]), lanes, 100.0)
    assert is_over_road(roads, 0, control, 0.0)
    assert is_footprint_over_road(roads, 0, control, 0.0, 1.0, 0.5)
    assert is_footprint_over_road(roads, 0, control, 0.0, 4.5, 1.8) is fits
