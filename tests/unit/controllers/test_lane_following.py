"""Lane keeping and lane changes of cars and buses, in Bullet and in single-track models."""

import math

import numpy as np
import pytest

from smarts.types.actions import ActionSpaceType, CommandMode, LaneAction
from smarts.types.agent_states import ChangePhase
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.vehicles import VehicleKind
from tests import maps
from tests.unit.controllers.rig import agent, winding
from tests.worlds import Car

CAR, BUS = VehicleKind.PASSENGER, VehicleKind.BUS
KEEP, SLOW, LEFT, RIGHT = LaneAction


@pytest.mark.parametrize(
    ("model", "kind", "speed", "radius"),
    [
        ("kinematic", CAR, 5.0, 25.0 / 3.0),
        ("bullet", CAR, 25.0, 625.0 / 3.0),
        # The bus turns around 14 m at its lock; its centre needs a little more.
        ("bullet", BUS, 5.0, 17.0),
        ("dynamic", BUS, 25.0, 625.0 / 3.0),
    ],
)
def test_keeps_its_lane_through_a_bend(rig, model, kind, speed, radius):
    graph = winding(radius, before=40.0 + 2.0 * speed)
    driven = rig([agent(10.0, 0.0, speed=speed, kind=kind)], graph=graph, model=model)
    driven.act(speed, 0.0)
    way = 20.0 + 2.0 * speed + radius * math.pi / 2 + 50.0
    log = driven.log(int(10 * way / speed), "lane_offset", "speed", "lateral_acceleration")
    assert np.abs(log[:, 0]).max() < 0.3
    # The bends need just 3 m/s^2, the limit of lateral acceleration, which costs little speed.
    assert log[:, 1].min() > 0.9 * speed
    assert np.abs(log[:, 2]).max() > 2.0 if radius > 10.0 and kind == CAR else True


@pytest.mark.parametrize(("kind", "speed"), [(CAR, 5.0), (BUS, 12.0), (CAR, 25.0)])
def test_changes_lanes_without_overshooting(rig, kind, speed):
    graph = maps.straight(lanes=2, length=600.0)
    driven = rig([agent(20.0, 0.0, speed=speed, kind=kind)], graph=graph)
    driven.act(speed, 0.0)
    driven.step(5)
    driven.act(speed, 1.0)
    y = driven.track(int(min(150, 5000 / speed)))[:, 1]
    assert y.max() < 3.2 + 0.3
    assert y.min() > -0.3
    assert y[-1] == pytest.approx(3.2, abs=0.2)
    assert np.flatnonzero(y > 3.2 - 0.3)[0] < 60


def test_a_lane_change_latches(rig):
    driven = rig([agent(20.0, 0.0, speed=10.0)], graph=maps.straight(lanes=3, length=600.0))
    driven.act(10.0, 1.0)
    phases = []
    for step in range(60):
        if step == 5:
            # A command to keep the lane does not abort the change.
            driven.act(10.0, 0.0)
        driven.step()
        phases.append(ChangePhase(int(driven.agents.change_phase[0, 0])))
    order = list(dict.fromkeys(phases))
    assert order == [ChangePhase.REQUESTED, ChangePhase.MOVING, ChangePhase.SETTLED, ChangePhase.NONE]
    assert phases.count(ChangePhase.SETTLED) == 1
    assert driven.agents.target_lane[0, 0] == 1
    assert driven.world.vehicles.lane[0, 0] == 1


def test_the_opposite_command_aborts_a_change_in_its_first_half(rig):
    driven = rig([agent(20.0, 0.0, speed=10.0)], graph=maps.straight(lanes=2, length=600.0))
    driven.act(10.0, 1.0)
    driven.step(8)
    assert 0.1 < driven.position[1] < 1.6
    driven.act(10.0, -1.0)
    driven.step()
    assert driven.agents.change_phase[0, 0] == ChangePhase.ABORTED
    assert driven.agents.effective[0, 0]
    y = driven.track(50)[:, 1]
    assert driven.agents.change_phase[0, 0] == ChangePhase.NONE
    assert y.max() < 1.6
    assert y[-1] == pytest.approx(0.0, abs=0.2)


class TestActionMask:
    def test_not_inside_junctions(self, rig):
        car = agent(0.0, -1.6, route=("west_in", "east_out"))
        driven = rig([car], graph=maps.crossing())
        assert driven.agents.action_mask[0, 0].tolist() == [True, True, False, False]

    def test_not_to_a_lane_that_soon_leaves_the_route(self, rig):
        roads = {
            "in": maps.Road([(0.0, 0.0), (200.0, 0.0)], 2),
            "on": maps.Road([(220.0, 0.0), (400.0, 0.0)]),
            "off": maps.Road([(220.0, 3.2), (300.0, 60.0)]),
        }
        links = [(("in", 0), ("on", 0)), (("in", 1), ("off", 0))]
        route = ("in", "on")
        cars = [agent(x, 0.0, speed=10.0, route=route) for x in (20.0, 150.0)]
        action_mask = rig(cars, graph=maps.graph_of(roads, links)).agents.action_mask[0]
        assert action_mask[0, LEFT]
        assert not action_mask[1, LEFT]

    def test_a_bus_lane_is_for_buses(self, rig):
        graph = maps.straight(lanes=2)
        kinds = graph.kind.copy()
        kinds[1] = 1
        object.__setattr__(graph, "kind", kinds)
        action_mask = rig([agent(20.0, 0.0), agent(60.0, 0.0, kind=BUS)], graph=graph).agents.action_mask[0]
        assert not action_mask[0, LEFT]
        assert action_mask[1, LEFT]


class TestLaneActions:
    @pytest.fixture
    def drive(self, rig):
        def make(*cars, **options):
            graph = options.pop("graph", maps.straight(lanes=2, length=800.0))
            return rig(list(cars), graph=graph, kind=ActionSpaceType.Lane, **options)

        return make

    def test_keep_lane_drives_at_the_limit(self, drive):
        driven = drive(agent(10.0, 0.0, speed=5.0))
        driven.act(KEEP)
        driven.step(100)
        assert driven.speed == pytest.approx(14.0, abs=0.1)
        assert driven.world.vehicles.desired_speed[0, 0] == 14.0

    def test_slow_down_brakes_steadily_to_a_standstill(self, drive):
        driven = drive(agent(10.0, 0.0, speed=10.0))
        driven.act(SLOW)
        speeds = driven.log(60, "speed")[:, 0]
        assert np.diff(speeds[2:30]) == pytest.approx(-0.25, abs=0.06)
        assert speeds[-1] == pytest.approx(0.0, abs=0.01)
        assert speeds.min() > -0.02

    def test_speed_is_limited_during_a_lane_change(self, drive):
        driven = drive(agent(10.0, 0.0, speed=13.5))
        driven.act(LEFT)
        driven.step(10)
        driven.act(KEEP)
        speeds = []
        while driven.agents.change_phase[0, 0] in (ChangePhase.REQUESTED, ChangePhase.MOVING):
            driven.step()
            speeds.append(driven.speed)
        assert len(speeds) > 5
        assert speeds == pytest.approx([12.5] * len(speeds), abs=0.3)
        driven.step(30)
        assert driven.speed > 13.0

    def test_brakes_before_a_turn(self, drive):
        car = agent(-80.0, -1.6, speed=13.0, route=("west_in", "south_out"))
        driven = drive(car, graph=maps.crossing())
        driven.act(KEEP)
        log = driven.log(160, "lane_offset", "lateral_acceleration", "speed")
        assert np.abs(log[:, 0]).max() < 0.4
        assert np.abs(log[:, 1]).max() < 4.0
        assert driven.position[1] < -20.0

    @pytest.mark.parametrize("end", ["north_out", "east_out"])
    def test_follows_its_route_through_a_junction(self, drive, end):
        driven = drive(agent(-60.0, -1.6, speed=8.0, route=("west_in", end)), graph=maps.crossing())
        driven.act(KEEP)
        driven.step(160)
        name = driven.graph.edge_ids[driven.graph.lane_edge[driven.world.vehicles.lane[0, 0]]]
        assert name == end
        assert abs(driven.world.vehicles.lane_offset[0, 0]) < 0.2


class TestBeforeTheFirstAction:
    @pytest.mark.parametrize("kind", [ActionSpaceType.Lane, ActionSpaceType.Trajectory])
    def test_keeps_its_lane_and_its_distance(self, rig, kind):
        cars = [agent(10.0, 0.0, speed=14.0), Car(80.0, 0.0, speed=0.0), Car(60.0, 3.2, speed=0.0)]
        driven = rig(cars, graph=maps.straight(lanes=2, length=400.0), kind=kind, model="dynamic")
        driven.step(120)
        assert driven.commands.mode[0, 0] == CommandMode.TRACK
        assert driven.speed == pytest.approx(0.0, abs=0.05)
        gap = 80.0 - 2.5 - (driven.position[0] + 2.25)
        assert 1.5 < gap < 4.0
        assert abs(driven.position[1]) < 0.1


def dropping(first=((0.0, 0.0), (150.0, 0.0)), after=((160.0, 0.0), (400.0, 0.0))):
    """Return a road of two lanes of which only the left one leads on."""
    return maps.graph_of(
        {"road": maps.Road([*first], 2), "after": maps.Road([(x, y + 3.2) for x, y in after])},
        [(("road", 1), ("after", 0))],
    )


@pytest.mark.parametrize(
    ("kind", "route"),
    [(ActionSpaceType.Lane, ()), (ActionSpaceType.LaneWithContinuousSpeed, ("road", "after"))],
)
def test_merges_where_its_lane_ends_and_the_one_beside_leads_on(rig, route, kind):
    driven = rig([agent(20.0, 0.0, speed=15.0, route=route)], graph=dropping(), kind=kind)
    driven.act(KEEP) if kind == ActionSpaceType.Lane else driven.act(15.0, 0.0)
    track = driven.track(140)
    # Not before the front is 20 m and 4 s of travel from the end of the lane.
    assert np.abs(track[track[:, 0] < 150.0 - 20.0 - 4.0 * 16.0 - 2.25, 1]).max() < 0.1
    assert track[-1, 0] > 165.0
    assert np.abs(track[track[:, 0] > 150.0, 1] - 3.2).max() < 0.5


def test_waits_for_a_gap_before_its_lane_ends(rig):
    queue = [Car(x, 3.2) for x in np.arange(60.0, 150.0, 6.0)]
    driven = rig([agent(20.0, 0.0, speed=12.0, route=("road", "after")), *queue], graph=dropping())
    driven.act(12.0, 0.0)
    track = driven.track(200)
    assert track[-1, 0] == pytest.approx(150.0 - 15.0 - 2.25, abs=1.0)
    assert np.abs(track[:, 1]).max() < 0.2
    driven.world.vehicles.alive[0, 1:] = False
    assert driven.track(150)[-1, 0] > 165.0


def test_stops_before_the_end_of_a_road_that_is_not_its_way(rig):
    graph = maps.crossing(length=200.0)
    mission = AgentMission(route=("west_in", "east_out"), goal=GoalKind.POSITION, goal_lane=0, goal_s=20.0)
    start = Car(60.0, 1.6 - 3.2, 0.0, 15.0, mission)
    driven = rig([start], graph=graph)
    # It has left its route: to the north.
    driven.world.vehicles.position[0, 0] = 1.6, 60.0
    driven.world.vehicles.heading[0, 0] = math.pi / 2
    driven.vehicles.reset(driven.rows)
    driven.made.match()
    driven.act(25.0, 0.0)
    driven.step(300)
    # The front stops two metres before the end.
    assert driven.position[1] == pytest.approx(210.0 - 2.0 - 2.5, abs=1.0)
    assert driven.world.vehicles.speed[0, 0] < 0.1


WAY = ("west_in", "east_out")
GOAL = {"goal": GoalKind.POSITION, "goal_lane": 0, "goal_s": 190.0}


@pytest.mark.parametrize("mission", [{"route": WAY}, {"route": WAY, **GOAL}, {"route": ()}])
def test_drives_to_the_end_of_its_route_and_off_the_map_at_speed(rig, mission):
    start = Car(150.0, -1.6, 0.0, 15.0, AgentMission(**mission))
    driven = rig([start], graph=maps.crossing(length=200.0))
    driven.act(15.0, 0.0)
    track = driven.track(40)
    assert track[-1, 0] > 205.0
    assert driven.world.vehicles.speed[0, 0] > 14.0
