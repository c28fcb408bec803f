"""Every mission of some scenarios driven to its goal: the lanes found are those of the route, in order."""

import numpy as np
import pytest

from smarts.roads.scene import Scene
from smarts.sim.map_matching import MapMatcher
from smarts.sim.schedule import Schedule
from smarts.sim.starts import corridor_of
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from tests.worlds import Car, world_of

SCENARIOS = ["intersection", "double_merge", "loop", "city"]
SPACING, BEGIN = 0.8, 0.05


def way_along(graph, start, mission):
    """Return places (lane, s) from a start to its goal, with lane changes half-way along roads."""
    corridor = corridor_of(graph, mission.route)
    places, row = [], int(np.flatnonzero(corridor.lane == start)[0])

    def onward(row):
        return corridor.onward[corridor.onward_start[row] : corridor.onward_start[row + 1]].tolist()

    last = int(corridor.group[-1])
    while True:
        lane, group = int(corridor.lane[row]), int(corridor.group[row])
        beside = np.flatnonzero(corridor.group == group).tolist()
        if group == last:
            target = next(other for other in beside if corridor.lane[other] == mission.goal_lane)
        else:
            target = next(other for other in [row, *beside] if onward(other))
        whole = float(graph.length[lane])
        if target != row:
            places += [(lane, s) for s in np.arange(BEGIN, whole / 2, SPACING)]
            lane, whole = int(corridor.lane[target]), float(graph.length[corridor.lane[target]])
            places += [(lane, s) for s in np.arange(whole / 2, whole - BEGIN, SPACING)]
        else:
            places += [(lane, s) for s in np.arange(BEGIN, whole - BEGIN, SPACING)]
        if group == last:
            goal = [number for number, place in enumerate(places) if place[0] == mission.goal_lane]
            return [
                place for place in places[: goal[-1] + 1] if place[0] != lane or place[1] <= mission.goal_s
            ]
        row = onward(target)[0]


@pytest.mark.parametrize(
    ("name", "aside"),
    [
        ("roundabout", 0.0),
        ("intersection", -0.4),
        *(pytest.param(name, 0.0, marks=pytest.mark.nightly) for name in SCENARIOS),
    ],
)
def test_agents(name, aside):
    built = build_scenario(name)
    graph, schedule = built.roads(), Schedule([built], ["ego"])
    for episode in range(len(schedule.combinations)):
        start = schedule.start(0, episode).agents[0]
        x, y, heading = start.pose
        made = world_of([Car(x, y, heading, mission=start.mission)], maps=[graph])
        vehicles, agents = made.world.vehicles, made.world.agents
        matcher, rows = MapMatcher(Scene(made.world, made.atlas, made.routes)), np.ones(1, np.bool_)
        way = way_along(graph, int(vehicles.lane[0, 0]), start.mission)
        found, progress = [], []
        begin = agents.route_progress[0, 0]
        assert start.mission.route_length == pytest.approx(agents.remaining[0, 0], abs=0.1)
        for lane, s in way:
            pose = graph.pose_at(lane, s, aside)
            vehicles.position[0, 0], vehicles.heading[0, 0] = pose[:2], pose[2]
            matcher.match(rows)
            assert agents.on_route[0, 0]
            assert agents.on_road[0, 0]
            found.append(int(vehicles.lane[0, 0]))
            progress.append(float(agents.route_progress[0, 0]))
        wanted = [lane for lane, _ in way]
        # Off the middle, two ways that set out from one lane into two lanes of a road are hard to tell apart.
        assert (graph.lane_edge[found] == graph.lane_edge[wanted]).all() if aside else found == wanted
        # Where the lane changes, lanes beside each other may differ in length, in curves.
        assert np.diff(progress).min() > -2.5
        assert agents.remaining[0, 0] < 2 * SPACING
        assert progress[-1] > begin


@pytest.mark.parametrize(
    "name",
    ["intersection", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("double_merge", "loop"))],
)
def test_traffic_is_on_the_lane_that_sumo_says(name):
    built = build_scenario(name)
    graph = built.roads()
    compared = 0
    with traffic_run(built, "random_social_vehicles") as run:
        made = world_of([], maps=[graph], capacity=1)
        for states in run.steps(10):
            alive = np.flatnonzero(states.alive)
            maps = np.zeros(len(alive), np.int32)
            poses = states.position[alive], states.heading[alive]
            located = made.atlas.locate(maps, *poses, height=states.height[alive])
            driver = run.engine._simulations[0]
            vehicle = driver._library.vehicle
            for slot, lane in zip(alive.tolist(), located.lane.tolist(), strict=True):
                name_there = driver._ids[slot]
                # SUMO's lane is the front bumper's, and that of a vehicle that changes lanes jumps.
                is_whole = vehicle.getLanePosition(name_there) > states.length[slot] / 2 + 0.5
                if is_whole and abs(vehicle.getLateralLanePosition(name_there)) < 0.3:
                    assert graph.lane_ids[lane] == vehicle.getLaneID(name_there)
                    compared += 1
    assert compared > 500
