"""Who counts as not moving, and who waits, by hand: a step at a time."""

import math

import pytest

from smarts.types.events import Event, Outcome
from smarts.types.mission import AgentMission
from smarts.types.traffic import Signal
from tests import maps
from tests.maps import Road, graph_of
from tests.unit.sim.stage import ROAD, Stage
from tests.worlds import Car


def test_not_moving():
    stage = Stage(
        [Car(10.0, 0.0, mission=ROAD)], not_moving_steps=5, not_moving_distance=1.0, ending=Event.NOT_MOVING
    )
    # To and fro within a metre is no movement; after 1.5 m the clock begins anew.
    assert [stage.step((x, 0.0)) for x in (10.9, 9.5, 10.0, 10.2)] == [Event.NONE] * 4
    assert stage.step((11.5, 0.0)) == Event.NONE
    assert [stage.step((11.5, 0.0)) for _ in range(4)] == [Event.NONE] * 4
    assert stage.step((11.5, 0.0)) == Event.NOT_MOVING
    assert stage.agents.outcome[0, 0] == Outcome.NOT_MOVING
    assert stage.events.terminated[0, 0]


def at_a_light(x):
    """Return a vehicle at x on the way east, whose lane ends at x = -10, and the lane that has its light."""
    graph = maps.crossing()
    stage = Stage([Car(x, -1.6, mission=EASTWARD)], graph=graph, not_moving_steps=5)
    ways = graph.successors(graph.lane_number("west_in", 0)).tolist()
    (way,) = (way for way in ways if graph.lane_ids[graph.successors(way)[0]].startswith("east_out"))
    return stage, way


def test_a_red_light_stops_the_clock():
    stage, way = at_a_light(-49.9)
    stage.world.signals[0, way] = Signal.STOP
    assert [stage.step((-49.9, -1.6)) for _ in range(20)] == [Event.NONE] * 20
    stage.world.signals[0, way] = Signal.GO
    assert [stage.step((-49.9, -1.6)) for _ in range(4)] == [Event.NONE] * 4
    assert stage.step((-49.9, -1.6)) == Event.NOT_MOVING


def test_a_red_light_for_another_way_does_not():
    stage, way = at_a_light(-20.6)
    stage.world.signals[0] = Signal.STOP
    stage.world.signals[0, way] = Signal.GO
    assert [stage.step((-20.6, -1.6)) for _ in range(4)] == [Event.NONE] * 4
    assert stage.step((-20.6, -1.6)) == Event.NOT_MOVING


@pytest.mark.parametrize(
    ("other", "waits"),
    [
        (Car(24.5, 0.0), True),
        (Car(24.5, 1.7, heading=1.0), True),
        (Car(25.5, 0.0), False),  # 10.5 m from bumper to bumper
        (Car(24.5, 1.9), False),
        (Car(24.5, 0.0, speed=0.6), False),
        (Car(24.5, 0.0, heading=math.pi), False),
        (Car(3.0, 0.0), False),
    ],
)
def test_who_waits_behind_one_that_stands_does_not_rest(other, waits):
    stage = Stage([Car(10.0, 0.0, mission=ROAD), other], not_moving_steps=5)
    seen = [stage.step((10.0, 0.0)) for _ in range(8)]
    assert (Event.NOT_MOVING not in seen) == waits
    if waits:
        stage.world.vehicles.alive[0, 1] = False
        assert [stage.step((10.0, 0.0)) for _ in range(4)] == [Event.NONE] * 4
        assert stage.step((10.0, 0.0)) == Event.NOT_MOVING


def straight_over():
    """Return a crossing of which only the ways to the east and to the north are open, and a road beside it.

    They cross at (1.6, -1.6): the way to the north is met from y = -3.2 to 0, that to the east from x = 0 on.
    """
    links = [(("west_in", 0), ("east_out", 0)), (("south_in", 0), ("north_out", 0))]
    roads = {
        "west_in": Road([(-90, -1.6), (-10, -1.6)]),
        "east_out": Road([(10, -1.6), (90, -1.6)]),
        "south_in": Road([(1.6, -90), (1.6, -10)]),
        "north_out": Road([(1.6, 10), (1.6, 90)]),
        "beside": Road([(-90, 30), (90, 30)]),
    }
    return graph_of(roads, links)


NORTH = math.pi / 2
EASTWARD = AgentMission(route=("west_in", "east_out"))


def rests_at_the_crossing(x, other, speed=10.0, clock=5, signal=None):
    """Return whether one that stands at x before the crossing counts as not moving although another drives.

    A vehicle is 5 m long, so that its front bumper is 2.5 m ahead of the place given.
    """
    cars = [Car(x, -1.6, mission=EASTWARD), Car(*other, speed=speed)]
    stage = Stage(cars, graph=straight_over(), not_moving_steps=clock)
    if signal is not None:
        graph = stage.made.atlas.graphs[0]
        stage.world.signals[0, graph.successors(graph.lane_number("south_in", 0))] = signal
    seen = [stage.step((x, -1.6), other) for _ in range(clock + 3)]
    return Event.NOT_MOVING in seen


@pytest.mark.parametrize(
    ("x", "other", "speed", "rests"),
    [
        (-13.0, (1.6, -35.4, NORTH), 10.0, False),  # its front bumper is 29.7 m before the meeting point
        (-13.0, (1.6, -36.0, NORTH), 10.0, True),  # 30.3 m
        (-13.0, (1.6, -6.0, NORTH), 0.4, True),  # 0.3 m away, but it stands
        (-13.0, (1.6, -7.0, NORTH), 0.6, False),  # 1.3 m at 0.6 m/s
        (-13.0, (1.6, 2.4, NORTH), 10.0, False),  # its rear bumper is still in the way
        (-13.0, (1.6, 2.6, NORTH), 10.0, True),
        (-13.0, (-20.0, 30.0), 10.0, True),  # on another road
        (-13.0, (-25.0, -1.6), 10.0, True),  # behind
        (-13.0, (20.0, -1.6), 10.0, True),  # on the way ahead, and past the crossing
        (-20.4, (1.6, -30.0, NORTH), 10.0, False),  # the front bumper is 7.9 m before the line
        (-20.6, (1.6, -30.0, NORTH), 10.0, True),
        (-2.6, (1.6, -30.0, NORTH), 10.0, False),  # inside the junction, before the meeting point
        (-2.4, (1.6, -30.0, NORTH), 10.0, True),  # in the way of the other
    ],
)
def test_who_waits_for_those_who_cross_its_path_does_not_rest(x, other, speed, rests):
    assert rests_at_the_crossing(x, other, speed) == rests


def test_a_stream_that_a_red_light_holds_back_is_not_waited_for():
    assert rests_at_the_crossing(-13.0, (1.6, -30.0, NORTH), signal=Signal.STOP)
    assert not rests_at_the_crossing(-13.0, (1.6, -30.0, NORTH), signal=Signal.GO)


def test_two_who_wait_for_each_other_both_rest():
    northward = AgentMission(route=("south_in", "north_out"))
    cars = [Car(-13.0, -1.6, mission=EASTWARD), Car(1.6, -13.0, NORTH, mission=northward)]
    stage = Stage(cars, graph=straight_over(), not_moving_steps=5)
    for _ in range(5):
        stage.step((-13.0, -1.6), (1.6, -13.0, NORTH))
    assert stage.events.bits[0, :2].tolist() == [Event.NOT_MOVING, Event.NOT_MOVING]
