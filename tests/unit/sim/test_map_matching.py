"""Where everybody is: the fused kernel against the atlas, progress to the goal, laps."""

import math

import numpy as np
import pytest

from smarts.roads.scene import Scene
from smarts.sim.map_matching import MapMatcher
from smarts.types.mission import AgentMission, GoalKind
from tests.maps import Road, bend, crossing, graph_of, straight
from tests.road_queries import RoadQueries
from tests.worlds import Car, world_of

EAST = AgentMission(route=("west_in", "east_out"))


def ring():
    """Return a square track of one lane, about 380 m around."""
    corners = [(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)]
    inner = 10.0
    roads, names = {}, ["south", "east", "north", "west"]
    for number, name in enumerate(names):
        (ax, ay), (bx, by) = corners[number], corners[(number + 1) % 4]
        dx, dy = (bx - ax) / 100, (by - ay) / 100
        roads[name] = Road([(ax + inner * dx, ay + inner * dy), (bx - inner * dx, by - inner * dy)])
    links = [((name, 0), (names[(number + 1) % 4], 0)) for number, name in enumerate(names)]
    return graph_of(roads, links)


def test_one_kernel_finds_what_the_atlas_finds():
    rng = np.random.Generator(np.random.Philox(3))
    maps = [crossing(), bend()]
    rows = []
    for row in range(2):
        cars = [
            Car(*rng.uniform(-60, 60, 2), heading=rng.uniform(-3, 3), mission=EAST if row == 0 else None)
            for _ in range(4)
        ]
        rows.append(cars + [Car(*rng.uniform(-60, 60, 2), heading=rng.uniform(-3, 3)) for _ in range(9)])
    made = world_of(*rows, maps=maps)
    vehicles, agents = made.world.vehicles, made.world.agents
    row, slot = np.nonzero(vehicles.alive)
    routes = np.full(vehicles.alive.shape, -1, np.int32)
    routes[0, agents.slot[0]] = made.routes.number[0]
    found = RoadQueries.locate(
        made.atlas,
        made.world.map[row],
        vehicles.position[row, slot],
        vehicles.heading[row, slot],
        routes[row, slot],
        made.routes.table,
    )
    assert (vehicles.lane[row, slot] == found.lane).all()
    assert (vehicles.lane_position[row, slot] == found.s).all()
    assert (vehicles.lane_offset[row, slot] == found.t).all()
    place = agents.slot[0]
    ones = np.zeros(4, np.int32)
    assert (agents.on_road[0] == RoadQueries.on_road(made.atlas, ones, vehicles.position[0, place])).all()
    corners = RoadQueries.corners_on_road(
        made.atlas,
        ones,
        vehicles.position[0, place],
        vehicles.heading[0, place],
        vehicles.length[0, place],
        vehicles.width[0, place],
    )
    assert (agents.corners_on_road[0] == corners).all()
    done, remaining = RoadQueries.route_distances(
        made.atlas,
        made.routes.table,
        ones,
        made.routes.number[0],
        vehicles.lane[0, place],
        vehicles.lane_position[0, place],
    )
    on = np.isfinite(done) & agents.on_road[0]
    assert (agents.on_route[0] == on).all()
    assert agents.route_progress[0, on] == pytest.approx(done[on])
    assert agents.remaining[0, on] == pytest.approx(remaining[on])
    assert (vehicles.lane[~vehicles.alive] == -1).all()


def test_off_the_route_progress_stays_as_it_was():
    made = world_of([Car(-50.0, -1.6, mission=EAST)], maps=[crossing()])
    agents = made.world.agents
    before = agents.route_progress[0, 0], agents.remaining[0, 0]
    assert agents.on_route[0, 0]
    assert before[0] == pytest.approx(40.0)
    made.world.vehicles.position[0, 0] = 1.6, 50.0
    made.world.vehicles.heading[0, 0] = math.pi / 2
    made.match()
    assert not agents.on_route[0, 0]
    assert (agents.route_progress[0, 0], agents.remaining[0, 0]) == before


def move(made, x, y, heading=0.0):
    made.advance()
    made.world.step += 1
    made.world.vehicles.position[0, 0], made.world.vehicles.heading[0, 0] = (x, y), heading
    made.match()
    agents = made.world.agents
    return tuple(float(column[0, 0]) for column in (agents.route_progress, agents.remaining, agents.skipped))


def test_off_the_road_there_is_no_progress():
    mission = AgentMission(route=("road",), goal=GoalKind.POSITION, goal_lane=0, goal_s=150.0)
    made = world_of([Car(40.0, 0.0, mission=mission)], maps=[straight(lanes=1)])
    assert move(made, 42.0, 0.0) == pytest.approx((42.0, 108.0, 0.0))
    for x in (44.0, 80.0, 160.0):
        assert move(made, x, 60.0) == pytest.approx((42.0, 108.0, 0.0))
        assert not made.world.agents.on_route[0, 0]
    # Back on the road it is where it is, and what it left out is known.
    assert move(made, 90.0, 0.0) == pytest.approx((90.0, 60.0, 48.0))
    assert move(made, 92.0, 0.0) == pytest.approx((92.0, 58.0, 48.0))
    # An agent that comes back behind the place where it left has to drive that part again.
    move(made, 92.0, -9.0)
    assert move(made, 70.0, 0.0) == pytest.approx((70.0, 80.0, 48.0))


def test_an_agent_that_enters_beside_the_road():
    mission = AgentMission(route=("road",), goal=GoalKind.POSITION, goal_lane=0, goal_s=150.0)
    made = world_of([Car(40.0, 9.0, mission=mission)], maps=[straight(lanes=1)])
    assert made.world.agents.remaining[0, 0] == pytest.approx(110.0)
    assert not made.world.agents.on_route[0, 0]
    assert move(made, 60.0, 0.0) == pytest.approx((60.0, 90.0, 20.0))


def test_without_a_route_progress_is_the_way_along_the_lanes():
    radius = 30.0
    made = world_of([Car(radius, 0.0, math.pi / 2, mission=AgentMission())], maps=[bend(1, radius)])
    for step in range(1, 51):
        angle = 0.03 * step
        progress, _, _ = move(made, radius * math.cos(angle), radius * math.sin(angle), angle + math.pi / 2)
    assert progress == pytest.approx(45.0, rel=0.01)
    # Off the road it stays, and back along the lane it sinks.
    assert move(made, 0.0, 0.0)[0] == progress
    assert move(made, 0.0, radius, math.pi)[0] == progress
    assert move(made, 2.0, radius, math.pi)[0] == pytest.approx(progress - 2.0, abs=0.1)


def test_a_vehicle_that_stands_is_matched_again_when_its_route_map_or_episode_changes():
    # Where the ways straight on and to the left begin, the route decides.
    left = AgentMission(route=("west_in", "north_out"))
    made = world_of([Car(-8.0, -1.6, mission=left)], maps=[crossing(), straight(lanes=1)])
    vehicles, agents, world = made.world.vehicles, made.world.agents, made.world
    matcher, rows = MapMatcher(Scene(world, made.atlas, made.routes)), np.ones(1, np.bool_)

    def place():
        made.advance()
        matcher.match(rows)
        found = vehicles.lane[0, 0], vehicles.lane_position[0, 0], vehicles.lane_offset[0, 0]
        made.match()
        assert found == (vehicles.lane[0, 0], vehicles.lane_position[0, 0], vehicles.lane_offset[0, 0])
        return made.atlas.graphs[world.map[0]].lane_ids[found[0]]

    assert place() == place() == ":junction_2_0"
    agents.slot[0, 0] = -1
    assert place() == place() == ":junction_1_0"
    vehicles.heading[0, 0] = 0.4
    assert place() == place() == ":junction_2_0"
    world.map[0], world.step[0] = 1, -1
    assert place() == "road_0"
