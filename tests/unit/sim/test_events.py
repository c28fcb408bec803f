"""Each event, by hand: on straight roads and one crossing, a step at a time."""

import math

import numpy as np
import pytest

from smarts.agents.rules import AliveRule
from smarts.roads.lane_graph import LaneKind
from smarts.roads.scene import Scene
from smarts.sim.events import AgentEvents
from smarts.types.events import Contacts, Event, Outcome
from smarts.types.interface import SeatRules
from smarts.types.mission import GoalKind, SeatMission, Via
from smarts.types.seats import NEITHER, SeatState
from smarts.types.traffic import Signal
from tests import maps
from tests.maps import Road, graph_of
from tests.worlds import Car, world_of

SEATS = 4
ROAD = SeatMission(
    route=("road",), goal=GoalKind.POSITION, goal_position=(150.0, 0.0), goal_lane=0, goal_s=150.0
)


class Stage:
    """A hand-made world whose vehicles are put where a test wants them, and the judge of it."""

    def __init__(self, *rows, graph=None, ending=None, alive=(), **rules):
        self.made = world_of(*rows, maps=[graph or maps.straight()], seats=SEATS)
        self.world = self.made.world
        self.rules = SeatRules.allocate(SEATS)
        for name, value in rules.items():
            getattr(self.rules, name)[:] = value
        if ending is not None:
            self.rules.ending[:] = ending
        scene = Scene(self.world, self.made.atlas, self.made.routes)
        self.judge = AgentEvents(scene, self.rules, alive)
        self.contacts = Contacts.allocate(self.world.worlds, SEATS, self.world.vehicles.capacity)
        self.rows = np.ones(self.world.worlds, np.bool_)

    def step(self, *places, row=0, hits=()):
        """Move vehicles to (x, y) or (x, y, heading); return the events of the first seat's agent."""
        self.made.advance()
        vehicles = self.world.vehicles
        for slot, (x, y, *heading) in enumerate(places):
            vehicles.position[row, slot] = x, y
            vehicles.heading[row, slot] = heading[0] if heading else 0.0
        self.made.locate()
        self.contacts.partner[:] = -1
        for seat, partner in hits:
            self.contacts.partner[row, seat] = partner
        self.events = self.judge.detect(self.world, self.contacts, self.rows)
        return Event(int(self.events.bits[row, 0]))

    @property
    def seats(self):
        return self.world.seats


def test_nothing_happens_to_who_drives_in_its_lane():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    assert stage.step((11.0, 0.1)) == Event.NONE
    assert stage.seats.state[0, 0] == SeatState.ACTIVE
    assert not stage.events.just_done.any()
    assert not stage.events.finished.any()


def test_collision():
    stage = Stage([Car(10.0, 0.0, mission=ROAD), Car(15.0, 0.0)])
    assert stage.step((11.0, 0.0), (15.0, 0.0), hits=[(0, 1)]) == Event.COLLISION
    assert stage.seats.state[0, 0] == SeatState.DONE
    assert stage.seats.outcome[0, 0] == Outcome.COLLISION
    assert stage.events.just_done[0].tolist() == [True, False, False, False]
    assert stage.events.terminated[0, 0]
    assert not stage.events.truncated[0, 0]
    assert stage.events.finished[0]


def test_off_road_is_when_the_centre_leaves_and_on_shoulder_when_a_corner_does():
    # The road's right edge is 1.6 m right of lane 0, a car's side 0.9 m from its centre.
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    assert stage.step((11.0, -0.65)) == Event.NONE
    assert stage.step((12.0, -0.75)) == Event.ON_SHOULDER
    assert stage.seats.state[0, 0] == SeatState.ACTIVE
    assert stage.step((13.0, -1.65)) == Event.ON_SHOULDER | Event.OFF_ROAD
    assert stage.seats.outcome[0, 0] == Outcome.OFF_ROAD
    assert stage.events.terminated[0, 0]


def test_a_single_corner_is_enough_for_the_shoulder():
    # Turned right by 0.1, the front right corner is 1.15 m to the right of the centre, the rear one 0.65 m.
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    assert stage.step((11.0, -0.4, -0.1)) == Event.NONE
    assert stage.step((12.0, -0.5, -0.1)) == Event.ON_SHOULDER


def test_a_shoulder_lane_is_no_road():
    graph = graph_of(
        {"side": Road([(0, -3.2), (200, -3.2)], kind=LaneKind.SHOULDER), "road": Road([(0, 0), (200, 0)])}
    )
    stage = Stage([Car(10.0, 0.0, mission=ROAD)], graph=graph)
    assert stage.step((11.0, -1.0)) == Event.ON_SHOULDER
    assert stage.step((12.0, -3.2)) == Event.ON_SHOULDER | Event.OFF_ROAD


def two_ways():
    """Return a road to the east and, left of it, one to the west, each with two lanes."""
    return graph_of({"road": Road([(0, 0), (200, 0)], 2), "back": Road([(200, 9.6), (0, 9.6)], 2)})


def test_wrong_way_in_the_own_lane():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    assert stage.step((11.0, 0.0, math.radians(89.0))) & Event.WRONG_WAY == Event.NONE
    assert stage.step((11.0, 0.0, math.radians(91.0))) & Event.WRONG_WAY
    assert stage.step((11.0, 0.0, math.radians(-91.0))) & Event.WRONG_WAY


def test_the_other_side_of_the_own_road_is_wrong_way_but_not_off_route():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)], graph=two_ways())
    for x in range(11, 30):
        assert stage.step((float(x), 6.4)) == Event.WRONG_WAY
    # Round and back along the other side: still the same road.
    assert stage.step((29.0, 9.6, math.pi)) == Event.NONE
    assert stage.seats.off_route_since[0, 0] == NEITHER


def test_inside_a_junction_there_is_no_wrong_way():
    mission = SeatMission(route=("west_in", "east_out"))
    stage = Stage([Car(-20.0, -1.6, mission=mission)], graph=maps.crossing())
    assert stage.step((0.0, -1.6, math.pi)) & Event.WRONG_WAY == Event.NONE


def test_off_route_after_half_a_second():
    mission = SeatMission(route=("west_in", "north_out"), goal=GoalKind.POSITION, goal_position=(1.6, 80.0))
    stage = Stage([Car(-12.0, -1.6, mission=mission)], graph=maps.crossing())
    # It goes straight on, to the east.
    assert stage.step((15.0, -1.6)) == Event.NONE
    assert stage.seats.off_route_since[0, 0] == 1
    for x in (16.0, 17.0, 18.0, 19.0):
        assert stage.step((x, -1.6)) == Event.NONE
    assert stage.step((20.0, -1.6)) == Event.OFF_ROUTE
    assert stage.seats.outcome[0, 0] == Outcome.OFF_ROUTE


def test_back_on_the_route_in_time():
    mission = SeatMission(route=("west_in", "north_out"), goal=GoalKind.POSITION, goal_position=(1.6, 80.0))
    stage = Stage([Car(-12.0, -1.6, mission=mission)], graph=maps.crossing())
    for x in (15.0, 16.0, 17.0):
        stage.step((x, -1.6))
    assert stage.step((1.6, 20.0, math.pi / 2)) == Event.NONE
    assert stage.seats.off_route_since[0, 0] == NEITHER


@pytest.mark.parametrize("mission", [SeatMission(), SeatMission(route=("west_in", "north_out"))])
def test_without_a_goal_nobody_is_off_route(mission):
    stage = Stage([Car(-12.0, -1.6, mission=mission)], graph=maps.crossing())
    for x in range(15, 25):
        assert stage.step((float(x), -1.6)) == Event.NONE


def test_not_moving():
    stage = Stage(
        [Car(10.0, 0.0, mission=ROAD)],
        not_moving_steps=5,
        not_moving_distance=1.0,
        ending=Event.NOT_MOVING,
    )
    # To and fro within a metre is no movement; after 1.5 m the clock begins anew.
    assert [stage.step((x, 0.0)) for x in (10.9, 9.5, 10.0, 10.2)] == [Event.NONE] * 4
    assert stage.step((11.5, 0.0)) == Event.NONE
    assert [stage.step((11.5, 0.0)) for _ in range(4)] == [Event.NONE] * 4
    assert stage.step((11.5, 0.0)) == Event.NOT_MOVING
    assert stage.seats.outcome[0, 0] == Outcome.NOT_MOVING
    assert stage.events.terminated[0, 0]


def test_a_red_light_stops_the_clock():
    mission = SeatMission(route=("road",))
    stage = Stage([Car(10.0, 0.0, mission=mission)], graph=maps.straight(length=49.9), not_moving_steps=5)
    stage.world.signals[0, 0] = Signal.STOP
    assert [stage.step((10.0, 0.0)) for _ in range(20)] == [Event.NONE] * 20
    stage.world.signals[0, 0] = Signal.GO
    assert [stage.step((10.0, 0.0)) for _ in range(4)] == [Event.NONE] * 4
    assert stage.step((10.0, 0.0)) == Event.NOT_MOVING


def test_a_red_light_does_not_wind_the_clock_back():
    mission = SeatMission(route=("road",))
    stage = Stage([Car(10.0, 0.0, mission=mission)], graph=maps.straight(length=49.9), not_moving_steps=5)
    assert [stage.step((10.0, 0.0)) for _ in range(3)] == [Event.NONE] * 3
    stage.world.signals[0, 0] = Signal.STOP
    assert [stage.step((10.0, 0.0)) for _ in range(20)] == [Event.NONE] * 20
    stage.world.signals[0, 0] = Signal.GO
    assert stage.step((10.0, 0.0)) == Event.NONE
    assert stage.step((10.0, 0.0)) == Event.NOT_MOVING


def test_a_red_light_far_away_does_not():
    mission = SeatMission(route=("road",))
    stage = Stage([Car(10.0, 0.0, mission=mission)], graph=maps.straight(length=50.1), not_moving_steps=5)
    stage.world.signals[0, 0] = Signal.STOP
    assert [stage.step((10.0, 0.0)) for _ in range(4)] == [Event.NONE] * 4
    assert stage.step((10.0, 0.0)) == Event.NOT_MOVING


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
EASTWARD = SeatMission(route=("west_in", "east_out"))


def rests_at_the_crossing(x, other, speed=10.0, clock=5, signal=None):
    """Return whether one that stands at x before the crossing counts as not moving although another drives.

    A vehicle is 5 m long, so that its front bumper is 2.5 m ahead of the place given.
    """
    cars = [Car(x, -1.6, mission=EASTWARD), Car(*other, speed=speed)]
    stage = Stage(cars, graph=straight_over(), not_moving_steps=clock)
    if signal is not None:
        stage.world.signals[0, 2] = signal
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
    northward = SeatMission(route=("south_in", "north_out"))
    cars = [Car(-13.0, -1.6, mission=EASTWARD), Car(1.6, -13.0, NORTH, mission=northward)]
    stage = Stage(cars, graph=straight_over(), not_moving_steps=5)
    for _ in range(5):
        stage.step((-13.0, -1.6), (1.6, -13.0, NORTH))
    assert stage.events.bits[0, :2].tolist() == [Event.NOT_MOVING, Event.NOT_MOVING]


def test_the_clock_goes_on_behind_a_stream():
    stage = Stage(
        [Car(-13.0, -1.6, mission=EASTWARD), Car(1.6, -30.0, NORTH, speed=10.0)],
        graph=straight_over(),
        not_moving_steps=5,
    )
    places = [-30.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0]
    seen = [stage.step((-13.0, -1.6), (1.6, y, NORTH)) for y in places]
    assert seen == [Event.NONE] * 7 + [Event.NOT_MOVING]


def test_who_is_beside_its_route_waits_all_the_same():
    mission = SeatMission(route=("beside",))
    cars = [Car(-13.0, -1.6, mission=mission), Car(1.6, -30.0, NORTH, speed=10.0)]
    stage = Stage(cars, graph=straight_over(), not_moving_steps=5)
    seen = [stage.step((-13.0, -1.6), (1.6, -30.0, NORTH)) for _ in range(8)]
    assert not any(events & Event.NOT_MOVING for events in seen)


def test_time_out_counts_from_entry():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)], max_steps=3)
    stage.seats.entry_step[0, 0] = 2
    assert [stage.step((10.0 + step, 0.0)) for step in range(4)] == [Event.NONE] * 4
    assert stage.step((15.0, 0.0)) == Event.REACHED_MAX_EPISODE_STEPS
    assert stage.seats.outcome[0, 0] == Outcome.TIME_OUT
    assert stage.events.truncated[0, 0]
    assert not stage.events.terminated[0, 0]


POINT = SeatMission(route=("road",), goal=GoalKind.POSITION, goal_position=(150.0, 0.0), goal_radius=2.0)


@pytest.mark.parametrize(
    ("begin", "end", "reached"),
    [
        ((147.5, 0.0), (147.9, 0.0), False),
        ((147.5, 0.0), (148.1, 0.0), True),
        # At 60 m/s it is past the goal within one step.
        ((147.0, 0.0), (153.0, 0.0), True),
        ((147.0, 1.9), (153.0, 1.9), True),
        ((147.0, 2.1), (153.0, 2.1), False),
    ],
)
def test_a_goal_with_a_radius(begin, end, reached):
    stage = Stage([Car(*begin, mission=POINT)])
    assert (stage.step(end) == Event.REACHED_GOAL) == reached
    if reached:
        assert stage.seats.outcome[0, 0] == Outcome.GOAL
        assert stage.events.terminated[0, 0]


LINE = SeatMission(route=("road",), goal=GoalKind.LANE_LINE, goal_lane=1, goal_s=150.0)


@pytest.mark.parametrize("goal", [GoalKind.LANE_LINE, GoalKind.POSITION])
def test_across_the_line_in_the_goal_lane(goal):
    mission = SeatMission(
        route=("road",), goal=goal, goal_lane=1, goal_s=150.0, goal_position=(150.0, 3.2), goal_radius=0.5
    )
    stage = Stage([Car(148.0, 4.2, mission=mission)])
    assert stage.step((149.9, 4.2)) == Event.NONE
    assert stage.step((150.1, 4.2)) == Event.REACHED_GOAL


def test_across_the_line_in_another_lane_is_a_miss():
    stage = Stage([Car(148.0, 0.0, mission=LINE)])
    assert stage.step((150.1, 0.0)) == Event.NONE
    # To change into the goal lane behind the line does not help.
    assert stage.step((152.0, 3.2)) == Event.NONE
    assert stage.step((154.9, 3.2)) == Event.NONE
    assert stage.step((155.1, 3.2)) == Event.MISSED_GOAL
    assert stage.seats.outcome[0, 0] == Outcome.MISSED_GOAL
    assert stage.events.terminated[0, 0]


def crossed(goal_s):
    """Return a stage in which a car stands at the end of "west_in", whose 80 m end at x = -10."""
    graph = maps.crossing()
    mission = SeatMission(
        route=("west_in",), goal=GoalKind.LANE_LINE, goal_lane=graph.lane_of_id("west_in_0"), goal_s=goal_s
    )
    return Stage([Car(-11.0, -1.6, mission=mission)], graph=graph)


def test_a_line_at_the_very_end_of_its_lane():
    assert crossed(goal_s=79.9).step((-9.0, -1.6)) == Event.REACHED_GOAL


def test_a_line_at_the_very_end_where_roads_meet_at_an_angle():
    # Left of the middle of a left bend one is on the next road before one has passed the end of the last.
    turn = math.radians(30.0)
    far = 100.0 + 80.0 * math.cos(turn), 80.0 * math.sin(turn)
    graph = graph_of({"first": Road([(0, 0), (100, 0)]), "second": Road([(100, 0), far])})
    mission = SeatMission(goal=GoalKind.LANE_LINE, goal_lane=0, goal_s=100.0)
    stage = Stage([Car(98.6, 0.9, mission=mission)], graph=graph)
    assert not stage.step((99.2, 0.9)) & Event.REACHED_GOAL
    assert stage.step((99.7, 1.0, turn)) & Event.REACHED_GOAL
    assert stage.world.vehicles.lane[0, 0] == 1


def test_a_line_left_behind_at_the_end_of_its_road():
    stage = crossed(goal_s=78.5)
    assert stage.step((-9.0, -1.6)) == Event.MISSED_GOAL


def test_a_line_that_is_crossed_in_the_step_that_enters_its_road():
    # The junction ends at x = 10.
    graph = maps.crossing()
    mission = SeatMission(
        route=("west_in", "east_out"),
        goal=GoalKind.LANE_LINE,
        goal_lane=graph.lane_of_id("east_out_0"),
        goal_s=0.5,
    )
    stage = Stage([Car(9.0, -1.6, mission=mission)], graph=graph)
    assert stage.step((9.5, -1.6)) == Event.NONE
    assert stage.step((11.0, -1.6)) == Event.REACHED_GOAL


def ring():
    """Return a road of 100 m and a round one of 220 m that leads back to it."""
    return graph_of(
        {"side": Road([(0, 0), (100, 0)]), "round": Road([(110, 10), (110, 60), (-10, 60), (-10, 10)])},
        [(("side", 0), ("round", 0)), (("round", 0), ("side", 0))],
    )


def test_a_goal_that_the_route_passes_twice():
    # First come by, then arrive.
    mission = SeatMission(
        route=("side", "round", "side"),
        goal=GoalKind.POSITION,
        goal_position=(50.0, 0.0),
        goal_lane=0,
        goal_s=50.0,
    )
    stage = Stage([Car(40.0, 0.0, mission=mission)], graph=ring())
    assert [stage.step((x, 0.0)) for x in (49.0, 51.0, 60.0)] == [Event.NONE] * 3
    for place in (
        (110.0, 30.0, math.pi / 2),
        (50.0, 60.0, math.pi),
        (-10.0, 20.0, -math.pi / 2),
        (40.0, 0.0),
    ):
        assert stage.step(place) == Event.NONE
    assert stage.step((48.5, 0.0)) == Event.REACHED_GOAL


def test_off_the_map_at_the_end_of_a_road():
    for goal in (GoalKind.ENDLESS, GoalKind.OFF_MAP):
        stage = Stage([Car(198.0, 0.0, mission=SeatMission(goal=goal))])
        assert stage.step((199.9, 0.0)) == Event.NONE | Event.ON_SHOULDER
        assert stage.step((201.0, 0.0)) == Event.REACHED_GOAL
    assert Stage([Car(198.0, 0.0, mission=ROAD)]).step((201.0, 0.0)) & Event.OFF_ROAD
    # Beside the road, or over its begin, is off road for everybody.
    endless = Stage([Car(198.0, 0.0, mission=SeatMission())])
    assert endless.step((150.0, -3.0)) & Event.OFF_ROAD
    assert Stage([Car(1.0, 0.0, mission=SeatMission())]).step((-1.0, 0.0)) & Event.OFF_ROAD


def test_laps():
    mission = SeatMission(route=("road",), goal=GoalKind.LAPS, laps=2)
    stage = Stage([Car(10.0, 0.0, mission=mission)])
    assert stage.step((11.0, 0.0)) == Event.NONE
    stage.seats.lap[0, 0] = 1
    assert stage.step((12.0, 0.0)) == Event.LAP_COMPLETED
    assert stage.step((13.0, 0.0)) == Event.NONE
    stage.seats.lap[0, 0] = 2
    assert stage.step((14.0, 0.0)) == Event.LAP_COMPLETED | Event.REACHED_GOAL


@pytest.mark.parametrize("laps", [1, 2, 3])
@pytest.mark.parametrize(("y", "reached"), [(10.1, False), (9.8, True), (7.0, True)])
def test_laps_to_the_very_end_of_a_road(laps, y, reached):
    mission = SeatMission(
        route=("side", "round") * laps, goal=GoalKind.LAPS, laps=laps, goal_lane=1, goal_s=220.0
    )
    stage = Stage([Car(40.0, 0.0, mission=mission)], graph=ring())
    south, goal = -math.pi / 2, Event.LAP_COMPLETED | Event.REACHED_GOAL
    for lap in range(laps):
        places = (50.0, 60.0, math.pi), (-10.0, 20.0, south), (-10.0, 10.5, south)
        assert [stage.step(place) for place in places] == [Event.NONE] * 3
        found = stage.step((-9.9, y, south)) & goal
        is_last = lap == laps - 1
        assert found == ((goal if is_last else Event.LAP_COMPLETED) if reached else Event.NONE)
        if not reached:
            return
        assert stage.seats.lap[0, 0] == lap + 1
        assert stage.step((95.0, 0.0)) == Event.NONE
    # Round to the begin again, it is still behind the end.
    assert stage.seats.remaining[0, 0] == 0.0


def test_vias_are_hit_once_each():
    vias = (Via((20.0, 0.5), 0, 1.0, 5.0), Via((30.0, 5.0), 0, 1.0, 5.0))
    mission = SeatMission(route=("road",), vias=vias)
    stage = Stage([Car(15.0, 0.0, mission=mission)])
    assert stage.step((18.9, 0.0)) == Event.NONE
    # Its way leads past the point within the radius, though neither end is within it.
    assert stage.step((21.5, 0.0)) == Event.VIA_HIT
    assert stage.seats.via_hit[0, 0].tolist() == [True, False]
    assert stage.step((20.5, 0.0)) == Event.NONE
    assert stage.step((31.0, 0.0)) == Event.NONE


def three_agents():
    return [Car(10.0 + 10 * seat, 0.0, mission=ROAD) for seat in range(3)]


ALIVE = Event.COLLISION | Event.AGENTS_ALIVE_DONE


def test_too_few_agents_left():
    rule = AliveRule(0, np.array([False, True, True, False]), 2)
    stage = Stage(three_agents(), ending=ALIVE, alive=[rule])
    places = [(11.0, 0.0), (21.0, 0.0), (31.0, 0.0)]
    assert stage.step(*places) == Event.NONE
    assert stage.step(*places, hits=[(2, 5)]) == Event.AGENTS_ALIVE_DONE
    assert stage.seats.outcome[0, :3].tolist() == [Outcome.OTHER, Outcome.NONE, Outcome.COLLISION]
    assert stage.events.truncated[0, :3].tolist() == [True, False, False]
    assert stage.events.terminated[0, :3].tolist() == [False, False, True]
    assert not stage.events.finished[0]


def test_who_is_missed_is_counted_once_a_step():
    # Each ends when another one is gone: 2 goes, then 0 for want of 2, and only then 1 for want of 0.
    rules = [AliveRule(0, np.arange(SEATS) == 2, 1), AliveRule(1, np.arange(SEATS) == 0, 1)]
    stage = Stage(three_agents(), ending=ALIVE, alive=rules)
    places = [(11.0, 0.0), (21.0, 0.0), (31.0, 0.0)]
    stage.step(*places, hits=[(2, 5)])
    assert stage.seats.state[0, :3].tolist() == [SeatState.DONE, SeatState.ACTIVE, SeatState.DONE]
    stage.step(*places)
    assert stage.seats.state[0, 1] == SeatState.DONE
    assert stage.seats.outcome[0, 1] == Outcome.OTHER


def test_agents_to_come_are_left():
    rule = AliveRule(0, np.array([False, True, False, False]), 1)
    stage = Stage(three_agents()[:1], ending=ALIVE, alive=[rule])
    stage.seats.state[0, 1] = SeatState.WAITING
    assert stage.step((11.0, 0.0)) == Event.NONE
    stage.seats.state[0, 1] = SeatState.VACANT
    assert stage.step((12.0, 0.0)) == Event.AGENTS_ALIVE_DONE


def test_events_that_do_not_end_the_agent_are_told_all_the_same():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)], ending=0)
    assert stage.step((11.0, -3.0), hits=[(0, 3)]) & (Event.OFF_ROAD | Event.COLLISION)
    assert stage.seats.state[0, 0] == SeatState.ACTIVE


def test_agents_of_one_simulation_have_their_own_rules():
    stage = Stage([Car(10.0, 0.0, mission=ROAD), Car(30.0, 0.0, mission=ROAD)])
    stage.rules.ending[1] = Event.WRONG_WAY
    stage.step((11.0, -3.0), (31.0, -3.0))
    assert stage.seats.state[0, :2].tolist() == [SeatState.DONE, SeatState.ACTIVE]
    stage.step((11.0, -3.0), (31.0, 0.0, math.pi))
    assert stage.seats.outcome[0, 1] == Outcome.OTHER_TERMINAL
    assert stage.events.just_done[0].tolist() == [False, True, False, False]
    assert stage.events.finished[0]


def test_who_only_watches_is_not_ended():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    stage.seats.state[0, 0] = SeatState.SHADOWING
    assert stage.step((11.0, -3.0)) & Event.OFF_ROAD
    assert stage.seats.state[0, 0] == SeatState.SHADOWING


def test_simulations_that_rest_have_no_events():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)], [Car(10.0, 0.0, mission=ROAD)])
    stage.rows[1] = False
    stage.step((11.0, -3.0), row=1)
    assert stage.events.bits[1, 0] == 0
    assert stage.seats.state[1, 0] == SeatState.ACTIVE
    assert not stage.events.finished[1]


def test_an_overlap_at_the_start_voids_the_episode():
    stage = Stage([Car(10.0, 0.0, mission=ROAD), Car(30.0, 0.0, mission=ROAD)])
    stage.seats.state[0, 2] = SeatState.WAITING
    stage.contacts.partner[0, 1] = 7
    events = stage.judge.reset(stage.world, stage.contacts, stage.rows)
    assert stage.seats.outcome[0].tolist() == [Outcome.VOID] * 3 + [Outcome.NONE]
    assert stage.seats.state[0].tolist() == [
        SeatState.DONE,
        SeatState.DONE,
        SeatState.VACANT,
        SeatState.VACANT,
    ]
    assert events.truncated[0].tolist() == [True, True, False, False]
    assert not events.terminated.any()
    assert events.finished[0]


def test_a_clear_start_has_no_events():
    stage = Stage([Car(10.0, 0.0, mission=ROAD)])
    events = stage.judge.reset(stage.world, stage.contacts, stage.rows)
    assert not events.bits.any()
    assert not events.finished.any()
