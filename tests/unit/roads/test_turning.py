"""Places to turn round, on maps made by hand."""

import pytest

from smarts.roads.atlas import RoadAtlas
from smarts.roads.turning import can_turn_round
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
