"""Where a vehicle waits for others on a way through two crossings in a row, by hand."""

import math

import numpy as np
import pytest

from smarts.types.mission import AgentMission, GoalKind
from tests.maps import Road, graph_of
from tests.unit.roads.test_right_of_way import gap_of
from tests.worlds import Car, world_of

LINE = -20.0
"""Where the first crossing begins; it is 10 m long, as the second one."""


def two_crossings(between):
    """Return a road to the east that crosses two roads to the south and gives way at the second.

    Args:
        between: Length of the road between the crossings [m].
    """
    second = LINE + 10.0 + between
    roads = {
        "begin": Road([(-120.0, 0.0), (LINE, 0.0)]),
        "middle": Road([(LINE + 10.0, 0.0), (second, 0.0)]),
        "end": Road([(second + 10.0, 0.0), (120.0, 0.0)]),
    }
    links = [(("begin", 0), ("middle", 0)), (("middle", 0), ("end", 0))]
    for name, x in (("first", LINE + 5.0), ("second", second + 5.0)):
        roads[f"{name}_in"] = Road([(x, 80.0), (x, 5.0)])
        roads[f"{name}_out"] = Road([(x, -5.0), (x, -80.0)])
        links.append(((f"{name}_in", 0), (f"{name}_out", 0)))
    return graph_of(roads, links, {1: [3]})


def wait_for_one_at_the_second(between, front, length=5.0, speed=5.0, away=30.0, pace=None):
    """Return how far a vehicle drives before a car comes to the second crossing [m].

    Args:
        between: See `two_crossings`.
        front: Place of the vehicle's front [m].
        length: Its length [m].
        speed: Its speed [m/s].
        away: Distance of the car to the middle of the vehicle's way [m].
        pace: In place of those of all lanes [m/s].
    """
    graph = two_crossings(between)
    mission = AgentMission(
        route=("begin", "middle", "end"), goal=GoalKind.POSITION, goal_position=(119.0, 0.0)
    )
    own = Car(front - 0.5 * length, 0.0, 0.0, speed, mission, length=length)
    other = Car(LINE + 15.0 + between, away, -0.5 * math.pi, 8.0)
    return gap_of(world_of([own, other], maps=[graph]), pace=pace)


@pytest.mark.parametrize(("between", "length"), [(2.0, 5.0), (9.0, 12.0)])
def test_a_vehicle_waits_before_both_crossings_if_it_cannot_wait_between_them(between, length):
    """Its tail would stand less than 1 m behind the way of those that cross first, x = -13.4 m."""
    gap = wait_for_one_at_the_second(between, LINE - 3.0, length)
    assert gap == pytest.approx(3.0)


def test_a_vehicle_waits_between_two_crossings_that_are_far_enough_apart():
    """4 m before the second line; at the first one, that line is still too far away to matter."""
    assert wait_for_one_at_the_second(12.0, LINE + 10.0 + 8.0) == pytest.approx(4.0)
    assert wait_for_one_at_the_second(12.0, LINE - 3.0) == np.inf


def test_a_vehicle_that_is_past_the_first_line_waits_before_the_second_crossing():
    assert wait_for_one_at_the_second(4.0, LINE + 6.0) == pytest.approx(8.0)


@pytest.mark.parametrize(("pace", "gap"), [(None, np.inf), (10.0, np.inf), (1.0, 4.0)])
def test_a_vehicle_crosses_as_fast_as_the_table_of_paces_says(pace, gap):
    """It is 4 m before its line; the other car comes in 60 / 8 s. At 1 m/s it needs 19 s, at 10 m/s 3 s."""
    assert wait_for_one_at_the_second(12.0, LINE + 18.0, away=65.0, pace=pace) == pytest.approx(gap)
