"""What agents of the benchmark see, against values worked out by hand."""

import math

import numpy as np
import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.criteria import DoneCriteria, EventConfiguration
from smarts.observations.arrays import VECTOR, ArrayObservation
from smarts.observations.context import AdapterContext
from smarts.observations.lists import feature_list
from smarts.observations.scales import compressed, expanded
from smarts.roads.scene import Scene
from smarts.types.actions import ActionSpaceType
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.traffic import Signal
from smarts.types.vehicles import Owner
from tests.maps import bend, crossing, straight
from tests.worlds import Car, world_of

FRAMES, FEATURES = 3, 65
"""Decisions in a vector, and numbers of each."""
GOAL, LANE_OFFSET, SPEED, STEERING, HEADINGS, WAYPOINTS, NEIGHBOURHOOD = 0, 2, 3, 4, 5, 20, 25
"""Places in the numbers of one decision."""
ARRIVAL, LANE_CHANGES, RESTED, LIGHT = -1, -2, -3, -4
"""Places from the end of the vector."""


def mission(*route, goal=(190.0, 0.0)):
    return AgentMission(route=route, goal=GoalKind.POSITION, goal_position=goal, goal_radius=2.0)


def context_of(made, agents=1, interfaces=(), action=ActionSpaceType.Lane):
    return AdapterContext(
        Scene(made.world, made.atlas, made.routes),
        tuple(f"agent-{number}" for number in range(agents)),
        np.arange(agents, dtype=np.int32),
        action,
        period=5,
        max_steps=600,
        interfaces=interfaces or (benchmark_interface(),) * agents,
    )


def observation_of(made, agents=1, interfaces=(), features="benchmark"):
    return ArrayObservation(context_of(made, agents, interfaces), features)


def observe(observation):
    return observation.observe(np.ones(observation.arrays[VECTOR].shape[:2], np.bool_))


def look(made, agents=1, features="benchmark"):
    return observe(observation_of(made, agents, features=features))[VECTOR]


def with_image(size, resolution=1.0):
    return feature_list("benchmark").plus([{"image": {"size": size, "resolution": resolution}}])


def symlog(x):
    return math.copysign(math.log(1 + abs(x)), x)


@pytest.mark.parametrize(
    ("metres", "feature"), [(3.0, math.log(4) / math.log(51)), (-50.0, -1.0), (80.0, 1.0)]
)
def test_lengths_are_compressed(metres, feature):
    assert compressed(metres, 50.0) == pytest.approx(feature)
    assert expanded(feature, 50.0) == pytest.approx(max(-50.0, min(50.0, metres)))


def test_own_state():
    made = world_of([Car(50.0, 0.8, 0.1, 15.0, mission=mission("road"))], maps=[straight()])
    made.world.agents.steering[0, 0] = 0.3
    seen = look(made)[0, 0, :FEATURES]
    dx, dy = 140.0, -0.8
    ahead = dx * math.cos(0.1) + dy * math.sin(0.1)
    aside = dy * math.cos(0.1) - dx * math.sin(0.1)
    np.testing.assert_allclose(
        seen[GOAL : GOAL + 2], [symlog(ahead) / math.log(201), symlog(aside) / math.log(201)], rtol=1e-6
    )
    np.testing.assert_allclose(seen[LANE_OFFSET], 0.25, rtol=1e-6)
    np.testing.assert_allclose([seen[SPEED], seen[STEERING]], [0.5, 0.5], rtol=1e-6)
    np.testing.assert_allclose(seen[HEADINGS : HEADINGS + WAYPOINTS], math.sin(-0.1), rtol=1e-6)


def test_neighbours_nearest_first_relative_to_oneself():
    made = world_of(
        [
            Car(50.0, 0.0, math.pi / 2, 10.0, mission=mission("road")),
            Car(50.0, 30.0, 0.0, 6.0),
            Car(60.0, 0.0, math.pi / 2, 10.0),
            Car(120.0, 0.0),
        ],
        maps=[straight()],
    )
    seen = look(made)[0, 0, NEIGHBOURHOOD:FEATURES].reshape(8, 5)
    np.testing.assert_allclose(seen[0], [1 - 10 / 50, 0.0, -math.log(11) / math.log(51), 0.0, 0.0], atol=1e-6)
    # Drives east where the agent drives north: to its right, and falling back.
    ahead, backwards, aside = (
        math.log(31) / math.log(51),
        -math.log(11) / math.log(31),
        -math.log(7) / math.log(31),
    )
    np.testing.assert_allclose(seen[1], [1 - 30 / 50, ahead, 0.0, backwards, aside], atol=1e-6)
    assert not seen[2:].any()


def test_headings_follow_the_route_through_a_junction():
    left = world_of(
        [Car(-15.0, -1.6, mission=mission("west_in", "north_out", goal=(1.6, 80.0)))], maps=[crossing()]
    )
    right = world_of(
        [Car(-15.0, -1.6, mission=mission("west_in", "south_out", goal=(-1.6, -80.0)))], maps=[crossing()]
    )
    assert look(left)[0, 0, HEADINGS + WAYPOINTS - 1] > 0.7
    assert look(right)[0, 0, HEADINGS + WAYPOINTS - 1] < -0.7


def test_headings_are_those_of_the_lane_that_is_steered_for():
    made = world_of([Car(30.0, 0.0, math.pi / 2, mission=mission("bend"))], maps=[bend(lanes=3)])
    here = look(made)[0, 0, HEADINGS : HEADINGS + WAYPOINTS].copy()
    made.world.agents.target_lane[0, 0] = 2
    there = look(made)[0, 0, HEADINGS : HEADINGS + WAYPOINTS]
    # The inner lane turns more for each metre.
    assert np.all(there > here)
    np.testing.assert_allclose(there[9], math.sin(10 / (30 - 6.4)), atol=5e-3)


def test_the_stack_holds_three_decisions_oldest_first():
    made = world_of([Car(50.0, 0.0, speed=3.0, mission=mission("road"))], maps=[straight()])
    observation = observation_of(made)
    vector = observation.arrays[VECTOR][0, 0]
    stack = vector[: FRAMES * FEATURES].reshape(FRAMES, FEATURES)
    seen = []
    for speed in (3.0, 6.0, 9.0, 12.0):
        made.world.vehicles.speed[0, 0] = speed
        observe(observation)
        seen.append((stack[:, SPEED] * 30).round(3).tolist())
    assert seen == [[3, 3, 3], [3, 3, 6], [3, 6, 9], [6, 9, 12]]
    observation.reset(np.ones((1, 1), np.bool_))
    assert not vector.any()


def test_the_picture_from_above():
    """Row 0 is ahead, column 0 to the left: a car 4.8 m by 1.8 m covers five pixels of a metre by two."""
    cars = [
        Car(50.0, 1.6, 0.0, mission=mission("road"), owner=Owner.AGENT, length=4.8),
        Car(60.0, 1.6, math.pi / 2, length=4.8),
        Car(50.0, 7.6, math.pi, length=4.8, name="beyond the left edge of the road"),
        Car(42.0, 1.6, mission=mission("road"), length=4.8, name="another agent"),
    ]
    made = world_of(cars, maps=[straight(lanes=2)])
    image = observe(observation_of(made, features=with_image(24)))["image"]
    assert image.shape == (1, 1, 24, 24, 3)
    assert (image[..., 0] == image[..., 2]).all()
    picture = image[0, 0, :, :, 2]

    def box(level):
        rows, columns = np.nonzero(picture == level)
        return rows.min(), rows.max(), columns.min(), columns.max()

    # Pixel (12, 12) begins at the vehicle's centre; rows count from 12 m ahead, columns from 12 m left.
    assert box(255) == (10, 13, 11, 12)
    assert box(208) == (18, 21, 11, 12)
    traffic = picture == 160
    assert traffic[1, 10:14].all()
    assert traffic[2, 10:14].all()
    assert traffic[10:14, 5:7].all()
    assert traffic.sum() == 16
    assert picture[5, 0] == 0
    assert picture[5, 12] == 64


@pytest.mark.parametrize(
    ("arrival_order", "junctions", "expected"),
    [
        ((-1, -1, -1), (-1, -1, -1), (-1, -1, -1)),
        ((4, 2, 9), (7, 7, 7), (0.5, 0, 1)),
        ((4, 2, 9), (7, 5, 7), (0, 0, 0.5)),
    ],
)
def test_order_of_arrival(arrival_order, junctions, expected):
    cars = [Car(20.0 * n, 0.0, mission=mission("road"), name=f"a{n}") for n in range(3)]
    made = world_of(cars, maps=[straight()])
    made.world.agents.arrival_number[0, :3] = arrival_order
    made.world.agents.arrival_junction[0, :3] = junctions
    np.testing.assert_allclose(look(made, agents=3)[0, :, -1], expected)


def test_velocities_are_relative_to_where_the_vehicle_slides():
    own = Car(50.0, 0.0, speed=10.0, mission=mission("road"))
    made = world_of([own, Car(60.0, 0.0, speed=10.0)], maps=[straight()])
    made.world.vehicles.lateral_speed[0, 0] = 2.0
    seen = look(made)[0, 0, NEIGHBOURHOOD:FEATURES]
    np.testing.assert_allclose(expanded(seen[3:5], 30.0), [0.0, -2.0], atol=1e-5)


@pytest.mark.parametrize(("lane", "due"), [(0, 2 / 3), (1, 1 / 3), (2, 0.0)])
def test_lane_changes_due(lane, due):
    to_the_left = AgentMission(
        route=("road",), goal=GoalKind.POSITION, goal_position=(190.0, 6.4), goal_lane=2, goal_s=190.0
    )
    made = world_of([Car(50.0, 3.2 * lane, mission=to_the_left)], maps=[straight()])
    assert look(made)[0, 0, LANE_CHANGES] == pytest.approx(due)


def show_lights(made, road, **shown):
    """Let a road's lane show lights, by where the ways lead to: as traffic does, at the ways' begins."""
    graph = made.atlas.graphs[0]
    for way in graph.successors(graph.lane_number(road, 0)):
        leads_to = graph.lane_ids[graph.successors(way)[0]].partition("_")[0]
        made.world.signals[0, way] = shown.get(leads_to, Signal.NONE)


@pytest.mark.parametrize(
    ("signal", "light"), [(Signal.NONE, 0), (Signal.STOP, -1), (Signal.CAUTION, -0.5), (Signal.GO, 1)]
)
def test_the_light_at_the_end_of_the_lane(signal, light):
    made = world_of([Car(-50.0, -1.6, mission=mission("west_in", "east_out"))], maps=[crossing()])
    show_lights(made, "west_in", east=signal, north=Signal.STOP, south=Signal.GO)
    assert look(made)[0, 0, LIGHT] == light


def test_each_may_stand_for_its_own_time():
    cars = [Car(20.0 * n, 0.0, mission=mission("road"), name=f"a{n}") for n in range(3)]
    made = world_of(cars, maps=[straight()])
    made.world.step[0] = 50
    patient = benchmark_interface(event_configuration=EventConfiguration(not_moving_time=50.0))
    for_ever = benchmark_interface(done_criteria=DoneCriteria(not_moving=False))
    seen = observe(observation_of(made, 3, (benchmark_interface(), patient, for_ever)))[VECTOR]
    np.testing.assert_allclose(seen[0, :, RESTED], [0.25, 0.1, 0.0])


def test_sectors_are_counter_clockwise_from_straight_ahead():
    """A vehicle 10 m behind its leader, both drive north; another crosses to the left."""
    cars = [
        Car(50.0, 0.0, math.pi / 2, 10.0, mission=mission("road")),
        Car(50.0, 10.0, math.pi / 2, 7.0),
        Car(50.0, 30.0, math.pi / 2, 0.0, name="hidden behind the nearer one"),
        Car(30.0, 0.0, 0.0, 5.0),
        Car(50.0, 60.0, name="too far"),
    ]
    seen = look(world_of(cars, maps=[straight()]), features={"frames": 1, "features": ["neighbor_sectors"]})
    seen = seen.reshape(8, 5)
    near, far = math.log(11) / math.log(51), math.log(21) / math.log(51)
    np.testing.assert_allclose(
        seen[0], [1 - 10 / 50, -math.log(4) / math.log(31), 1 - 10 / 3 / 5, near, 0.0], atol=1e-6
    )
    np.testing.assert_allclose(
        seen[2], [1 - 20 / 50, -math.log(6) / math.log(31), 1 - 4 / 5, 0.0, far], atol=1e-6
    )
    assert not seen[[1, 3, 4, 5, 6, 7]].any()
