"""Which vehicle waits at a crossing of two roads, by hand; the line of the south is at y = -10."""

import math

import numpy as np
import pytest

from smarts.dynamics.performance import performance
from smarts.geometry.binding import bind
from smarts.observations.arrays import ArrayObservation
from smarts.observations.surroundings import OWN_VEHICLE, Own
from smarts.roads.precedence import is_in_the_way
from smarts.roads.right_of_way import gap_to_wait
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.traffic import Signal
from tests.maps import crossing
from tests.unit.observations.test_features import context_of
from tests.worlds import Car, place_on_route, world_of

ARMS = ("west", "south", "east", "north")
TURNS = [(a, b) for a in ARMS for b in ARMS if a != b]
LINE = 17.5
"""From the front bumper of the vehicle to its line [m]."""


def minor(arms):
    """Return rules by which all ways from some arms give way to all others."""
    others = [turn for turn in TURNS if turn[0] not in arms]
    return {turn: others for turn in TURNS if turn[0] in arms}


ALL_STOP = {turn: [other for other in TURNS if other[0] != turn[0]] for turn in TURNS}
SOUTH_WAITS, WEST_WAITS = minor(["south"]), minor(["west"])
TO_THE_NORTH = AgentMission(
    route=("south_in", "north_out"), goal=GoalKind.POSITION, goal_position=(1.6, 80.0)
)
TO_THE_WEST = AgentMission(route=("south_in", "west_out"), goal=GoalKind.POSITION, goal_position=(-80.0, 1.6))
TO_THE_EAST = AgentMission(route=("west_in", "east_out"), goal=GoalKind.POSITION, goal_position=(80.0, -1.6))


def gap_of(made, agent=0, margins=1.0, pace=None):
    """Return what the kernel finds for an agent; `pace` is that of all lanes [m/s]."""
    state, roads, routes = made.world.state, made.atlas.roads, made.routes.current
    slot, row, place = place_on_route(made, agent)
    able = performance(made.atlas)
    if pace is not None:
        able = able._replace(pace=np.full_like(able.pace, pace))
    return bind(gap_to_wait, state, roads, routes, able)(0, slot, row, place, margins)


def wait_for(
    *cars,
    rules,
    speed=8.0,
    y=-30.0,
    mission=TO_THE_NORTH,
    signals=(),
    accelerations=(),
    widths=None,
    turns=(),
):
    """Return how far a vehicle from the south drives at most [m].

    `accelerations` are those of the cars, `turns` the edges that the cars after the first one signal.
    """
    graph = crossing(gives_way=rules, widths=widths or {})
    made = world_of([Car(1.6, y, math.pi / 2, speed, mission), *cars], maps=[graph])
    made.world.vehicles.next_edge[0, 1 : 1 + len(turns)] = [*map(graph.edge_number, turns)]
    made.world.vehicles.acceleration[0, : len(accelerations)] = accelerations
    for turn, light in signals:
        made.world.signals[0, graph.lane_ids.index(f":junction_{TURNS.index(turn)}_0")] = light
    return gap_of(made)


def from_the_west(x, speed, **more):
    return Car(x, -1.6, 0.0, speed, **more)


@pytest.mark.parametrize(
    ("x", "speed", "waits"),
    [(-40.0, 10.0, True), (-89.0, 3.0, False), (-60.0, 0.0, False), (-0.5, 0.0, True)],
)
def test_a_vehicle_without_priority_waits_for_those_that_come(x, speed, waits):
    """It waits for a vehicle that stands in its way, but neither for later ones nor for a queue."""
    assert wait_for(from_the_west(x, speed), rules=SOUTH_WAITS) == (LINE if waits else np.inf)


@pytest.mark.parametrize(
    ("x", "speed", "waits"),
    [(-40.0, 10.0, False), (-20.0, 10.0, True), (-0.5, 0.0, True), (-14.0, 0.0, False)],
)
def test_a_vehicle_with_priority_waits_for_those_that_cannot_stop(x, speed, waits):
    assert wait_for(from_the_west(x, speed), rules=WEST_WAITS) == (LINE if waits else np.inf)


def test_a_turn_to_the_left_waits_for_oncoming_traffic_only():
    rules = {("south", "west"): [("north", "south")]}
    oncoming, following = Car(-1.6, 45.0, -math.pi / 2, 10.0), Car(1.6, -45.0, math.pi / 2, 10.0)
    assert wait_for(oncoming, rules=rules, mission=TO_THE_WEST) == LINE
    assert wait_for(oncoming, rules=rules) == np.inf
    assert wait_for(following, rules=rules, mission=TO_THE_WEST) == np.inf


@pytest.mark.parametrize(
    ("turn", "waits"),
    [("south_out", True), ("west_out", True), ("east_out", False), ("north_in", True), (None, True)],
)
def test_a_turn_to_the_left_waits_for_oncoming_vehicles_that_do_not_signal_otherwise(turn, waits):
    """Two that turn to the left do not meet. An edge that its lane does not lead to says nothing."""
    rules = {("south", "west"): [("north", "south"), ("north", "west")]}
    oncoming = Car(-1.6, 45.0, -math.pi / 2, 10.0)
    turns = (turn,) if turn else ()
    gap = wait_for(oncoming, rules=rules, mission=TO_THE_WEST, turns=turns)
    assert (gap == LINE) == waits


def test_a_red_light_holds_others_back():
    car = from_the_west(-40.0, 10.0)
    held = [(turn, Signal.STOP) for turn in TURNS if turn[0] == "west"]
    assert wait_for(car, rules=SOUTH_WAITS, signals=held) == np.inf
    late = [(turn, Signal.STOP) for turn in TURNS if turn[0] == "west"]
    assert wait_for(from_the_west(-20.0, 12.0), rules=SOUTH_WAITS, signals=late) == LINE


def test_of_two_without_rules_the_first_goes():
    for x, waits in ((-25.0, True), (-35.0, False)):
        assert (wait_for(from_the_west(x, 8.0), rules={}) == LINE) == waits


def test_a_longer_vehicle_needs_a_longer_gap():
    gaps = [
        wait_for(from_the_west(-61.0, 10.0), rules=SOUTH_WAITS, speed=8.0),
        wait_for(from_the_west(-55.0, 10.0, length=18.0), rules=SOUTH_WAITS, speed=8.0),
    ]
    assert gaps == [np.inf, LINE]


def test_inside_the_junction_a_vehicle_waits_before_the_meeting():
    """The ways overlap from about y = -3.2 on, and its front is at y = -6.5."""
    gap = wait_for(from_the_west(-11.0, 8.0), rules=SOUTH_WAITS, speed=1.0, y=-9.0)
    assert 1.0 < gap < 4.0


def test_a_vehicle_does_not_stop_in_the_way_of_others():
    """The queue behind the junction leaves no room for it, unless it moves on."""
    for speed, gap in ((0.0, LINE), (5.0, np.inf)):
        assert wait_for(Car(1.6, 13.0, math.pi / 2, speed), rules={}) == gap
    assert wait_for(Car(1.6, 25.0, math.pi / 2, 0.0), rules={}) == np.inf


def test_of_those_that_stand_one_goes_and_all_in_turn():
    """Right before left from four sides: each waits for one that waits."""
    ring = dict(zip(ARMS, (*ARMS[1:], ARMS[0]), strict=True))  # arm -> the arm to its right
    straight = {arm: ARMS[(i + 2) % 4] for i, arm in enumerate(ARMS)}
    rules = {(arm, straight[arm]): [(ring[arm], straight[ring[arm]])] for arm in ARMS}
    places = {"west": (-14.0, -1.6, 0.0), "south": (1.6, -14.0, 0.5), "east": (14.0, 1.6, 1.0)}
    places["north"] = (-1.6, 14.0, -0.5)
    cars = []
    for arm in ARMS:
        x, y, turn = places[arm]
        end = f"{straight[arm]}_out"
        goal = -5.0 * x if abs(x) > 2 else x, -5.0 * y if abs(y) > 2 else y
        mission = AgentMission(route=(f"{arm}_in", end), goal=GoalKind.POSITION, goal_position=goal)
        cars.append(Car(x, y, turn * math.pi, 0.0, mission))
    went = set()
    for step in range(0, 4000, 40):
        made = world_of(cars, maps=[crossing(gives_way=rules)])
        made.world.step[:] = step
        goes = [agent for agent in range(4) if gap_of(made, agent) == np.inf]
        assert goes
        went |= set(goes)
    assert went == {0, 1, 2, 3}


@pytest.mark.parametrize(("south", "west"), [(3.2, 3.2), (5.0, 3.2), (3.2, 5.0)])
@pytest.mark.parametrize(("x", "waits"), [(-3.2, False), (-2.8, True), (5.0, True), (5.4, False)])
def test_the_room_that_vehicles_need_does_not_depend_on_their_lanes(south, west, x, waits):
    """The own way covers x = 1.6 +- (0.9 + 0.2): the vehicle's half width and the slack.

    A vehicle of 5 m stands in the way if its front is less than 1 m before that, or its tail not behind it.
    """
    gap = wait_for(from_the_west(x, 0.0), rules=WEST_WAITS, widths={"south": south, "west": west})
    assert gap == (LINE if waits else np.inf)


@pytest.mark.parametrize(("x", "is_there"), [(-2.15, False), (-2.05, True), (5.25, True), (5.35, False)])
def test_a_vehicle_that_stands_is_in_the_way_of_a_footprint_that_would_touch_it(x, is_there):
    """That of the way from x = 0.7 to 2.5 comes nearer than 0.3 m to a car of 5 m with its middle at x."""
    graph = crossing()
    cars = [Car(1.6, -30.0, math.pi / 2, 0.0, TO_THE_NORTH), from_the_west(x, 0.0)]
    made = world_of(cars, maps=[graph])
    roads = made.atlas.roads
    own, its = (
        graph.lane_ids.index(f":junction_{TURNS.index(way)}_0")
        for way in (("south", "north"), ("west", "east"))
    )
    rows = range(int(roads.conflict_start[own]), int(roads.conflict_start[own + 1]))
    (place,) = [row for row in rows if roads.conflict_lane[row] == its]
    assert bind(is_in_the_way, made.world.state, roads)(0, 0, 1, place, own) == is_there


@pytest.mark.parametrize(
    ("y", "speed", "acceleration", "stops"),
    [
        (-30.0, 8.0, 0.0, True),
        (-14.5, 2.0, -2.0, True),
        (-14.5, 2.0, 2.0, False),
        (-13.5, 0.0, 0.0, False),
        (-20.0, 0.0, 0.0, True),
        (-14.5, 8.0, 0.0, False),
        (-9.0, 3.0, 0.0, False),
    ],
)
def test_where_all_have_to_stop_a_vehicle_stops_at_its_line(y, speed, acceleration, stops):
    """Unless it has stopped there, can no longer stop, or is past it; its front is 2.5 m ahead."""
    gap = wait_for(rules=ALL_STOP, y=y, speed=speed, accelerations=[acceleration])
    assert gap == pytest.approx(-10.0 - 2.5 - y if stops else np.inf)


@pytest.mark.parametrize(
    ("x", "speed", "acceleration", "waits"),
    [
        (-30.0, 8.0, 0.0, False),
        (-14.0, 1.0, -1.0, False),
        (-13.0, 1.0, 1.5, True),
        (-6.0, 3.0, 1.5, True),
        (-19.0, 8.0, 0.0, True),
    ],
)
def test_where_all_have_to_stop_a_vehicle_waits_for_one_that_goes(x, speed, acceleration, waits):
    """Not for one that comes or brakes; but for one that starts, is in the junction, or cannot stop."""
    car = from_the_west(x, speed)
    gap = wait_for(car, rules=ALL_STOP, y=-13.5, speed=0.0, accelerations=[0.0, acceleration])
    assert gap == pytest.approx(1.0 if waits else np.inf)


@pytest.mark.parametrize("since", [(100, 90), (90, 100), (100, 100)])
def test_where_all_have_to_stop_the_first_that_stopped_goes(since):
    """The vehicle of the lower slot goes if both have stopped in one step."""
    cars = [Car(1.6, -13.5, math.pi / 2, 0.0, TO_THE_NORTH), from_the_west(-13.5, 0.0, mission=TO_THE_EAST)]
    first = 1 if since[1] < since[0] else 0
    for step in range(100, 250, 10):
        made = world_of(cars, maps=[crossing(gives_way=ALL_STOP)])
        made.world.step[:], made.world.vehicles.standing_since[0, :2] = step, since
        assert [agent for agent in range(2) if gap_of(made, agent) == np.inf] == [first]


def test_where_all_have_to_stop_they_take_turns_if_the_first_does_not_go():
    """After `PATIENCE`, 15 s."""
    went = set()
    for step in range(260, 4000, 40):
        cars = [
            Car(1.6, -13.5, math.pi / 2, 0.0, TO_THE_NORTH),
            from_the_west(-13.5, 0.0, mission=TO_THE_EAST),
        ]
        made = world_of(cars, maps=[crossing(gives_way=ALL_STOP)])
        made.world.step[:], made.world.vehicles.standing_since[0, :2] = step, (90, 100)
        (goes,) = [agent for agent in range(2) if gap_of(made, agent) == np.inf]
        went.add(goes)
    assert went == {0, 1}


@pytest.mark.parametrize(
    ("x", "margins", "waits"),
    [(-45.0, 1.0, True), (-45.0, 0.4, False), (-36.0, 0.4, True), (-53.0, 1.0, False)],
)
def test_a_driver_with_smaller_margins_takes_smaller_gaps(x, margins, waits):
    """It is out of the meeting after 32 m, 2.9 s at 2 m/s^2; the other comes there 3.3 to 4.3 s from now.

    That is x + 2 m, with 10 m/s and 1 m/s^2: 3.80, 3.80, 3.00 and 4.42 s. The margins are 1 s and 0.4 s.
    """
    graph = crossing(gives_way=SOUTH_WAITS)
    made = world_of([Car(1.6, -30.0, math.pi / 2, 8.0, TO_THE_NORTH), from_the_west(x, 10.0)], maps=[graph])
    assert gap_of(made, margins=margins) == (LINE if waits else np.inf)
    feature = [{"surroundings": {"margins": margins}}]
    seen = ArrayObservation(context_of(made), feature).observe(np.ones((1, 1), np.bool_))
    assert seen[OWN_VEHICLE][0, 0, Own.YIELD_GAP] == (LINE if waits else np.inf)
