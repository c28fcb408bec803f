"""Where the tasks of missions lead: the plan by hand, and cut-ins and U-turns in Bullet among SUMO's cars."""

import math

import numpy as np
import pytest

from smarts.agents import AgentInterface
from smarts.errors import ScenarioError
from smarts.geometry.binding import bind
from smarts.sim.assembly import assemble
from smarts.sim.manoeuvres import plan_manoeuvres
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.events import Outcome
from smarts.types.guidance import GuidePhase
from smarts.types.mission import AgentMission, Task, TaskKind
from tests import maps
from tests.maps import Road, graph_of
from tests.raising import raises
from tests.worlds import Car, world_of

FREE, APPROACH, MANOEUVRE, OVER = GuidePhase
SPEED = 10.0
"""Speed of the vehicle to cut in on [m/s]."""


class Plan:
    """One agent and others on a map, and the guidance of the agent."""

    def __init__(self, x, y, *others, graph, task, speed=SPEED, heading=0.0):
        mission = AgentMission(route=(graph.edge_ids[0],), task=task)
        cars = [Car(x, y, heading, speed, mission), *others]
        self.made = world_of(cars, maps=[graph])
        world = self.made.world
        world.vehicles.speed[0, 0] = speed
        self.planner = bind(plan_manoeuvres, world.state, self.made.atlas.roads)
        self.plan()

    def plan(self, *places):
        """Put vehicles somewhere and plan."""
        for slot, place in enumerate(places):
            self.made.world.vehicles.position[0, slot] = place
        self.made.match()
        self.planner(np.ones(1, np.bool_))
        return self

    def __getattr__(self, name):
        return getattr(self.made.world.guidance, name)[0, 0]


def cutting_in(x, *others, lanes=2, radius=30.0, y=0.0, speed=SPEED, last=-1):
    task = Task(TaskKind.CUT_IN, radius, last)
    return Plan(x, y, *others, graph=maps.straight(lanes, 400.0), task=task, speed=speed)


def other(x, lane=1, speed=SPEED):
    return Car(x, 3.2 * lane, 0.0, speed)


class TestCutIn:
    @pytest.mark.parametrize(
        ("car", "phase"),
        [
            (other(129.8), APPROACH),  # 29.97 m away
            (other(130.0), FREE),  # 30.17 m
            (other(72.0), APPROACH),  # behind
            (other(120.0, lane=0), FREE),
            (other(110.0, lane=2), FREE),
        ],
    )
    def test_is_triggered_by_a_vehicle_in_the_lane_beside(self, car, phase):
        plan = cutting_in(100.0, car, lanes=3)
        assert (plan.phase, plan.speed > 0.0) == (phase, phase == APPROACH)

    @pytest.mark.parametrize(
        ("x", "speed"),
        [
            (112.0, 11.5),  # 3 m are lacking, and half a metre a second for each
            (100.0, 17.5),
            (90.0, 20.0),  # at most twice as fast
            (120.0, 7.5),
            (128.0, 5.0),  # at least half as fast
        ],
    )
    def test_goes_for_a_place_fifteen_metres_ahead(self, x, speed):
        plan = cutting_in(x, other(100.0))
        assert (plan.phase, plan.speed) == (APPROACH, pytest.approx(speed))

    @pytest.mark.parametrize(("ahead", "goes"), [(13.4, False), (13.6, True), (16.4, True), (16.6, False)])
    def test_goes_over_from_there(self, ahead, goes):
        plan = cutting_in(100.0 + ahead, other(100.0))
        assert plan.phase == (MANOEUVRE if goes else APPROACH)
        if goes:
            # 3 s on, in lane 1, a tenth faster than the other.
            assert (plan.lane, plan.s, plan.speed) == (1, pytest.approx(130.0 + ahead), pytest.approx(11.0))
            assert plan.begin.tolist() == pytest.approx([100.0 + ahead, 0.0, 0.0])

    @pytest.mark.parametrize(
        ("own", "others", "goes"),
        [
            # The other, 10 m behind, wants (2 + v + v dv / (2 sqrt 1.5)) / 2 in 1.5 s.
            (2.5, [other(100.0, speed=5.0)], True),
            (2.3, [other(100.0, speed=5.0)], False),
            (0.0, [other(100.0)], False),
            (10.0, [other(100.0)], True),
            # One ahead in that lane: 6 m are enough at the same speed, and 2 m less to go to the middle.
            (10.0, [other(100.0), other(130.0)], True),
            (10.0, [other(100.0), other(131.0, speed=4.0)], False),
            # Somebody changes into it from the lane beyond.
            (10.0, [other(100.0), Car(122.0, 5.5, 0.0, 10.0)], False),
            (10.0, [other(100.0), Car(122.0, 6.4, 0.0, 10.0)], True),
            # One ahead in its own lane.
            (10.0, [other(100.0), other(127.0, lane=0)], True),
            (10.0, [other(100.0), other(125.0, lane=0)], False),
            (10.0, [other(100.0), Car(127.4, 0.0, 0.0, 10.0, length=12.0)], False),
            # One that comes towards it is nobody to follow.
            (10.0, [other(100.0), Car(130.5, 3.2, math.pi)], True),
        ],
    )
    def test_goes_over_only_where_nobody_must_brake_hard(self, own, others, goes):
        plan = cutting_in(115.0, *others, lanes=3, speed=own)
        assert plan.phase == (MANOEUVRE if goes else APPROACH)

    def test_prefers_one_with_room_before_it(self):
        # It takes 5 m and twice 6 m.
        assert cutting_in(108.0, other(100.0), other(121.0)).target == 2
        assert cutting_in(108.0, other(100.0), other(123.0)).target == 1
        assert cutting_in(108.0, other(100.0), other(115.0), other(125.0)).target == 3
        # Without room anywhere it stays with whom it has.
        plan = cutting_in(108.0, other(100.0), other(121.0), other(137.9), radius=25.0)
        assert plan.target == 1
        assert plan.plan((112.0, 0.0)).target == 1

    def test_keeps_its_distance_while_it_goes_over(self):
        plan = cutting_in(115.0, other(100.0), other(140.0))
        assert (plan.phase, plan.speed) == (MANOEUVRE, pytest.approx(11.0))
        plan.made.world.vehicles.speed[0, 2] = 0.0
        assert plan.plan((127.0, 1.5)).speed == pytest.approx(math.sqrt(2.25 + 3.0 * 6.0) - 1.5)
        plan.made.world.vehicles.speed[0, 2] = 20.0
        assert plan.plan((127.0, 1.5)).speed == pytest.approx(11.0)

    def test_waits_for_one_that_is_no_longer_beside(self):
        plan = cutting_in(100.0, other(100.0), lanes=3)
        assert plan.speed == pytest.approx(17.5)
        plan.plan((100.0, 0.0), (100.0, 6.4))
        assert (plan.phase, plan.speed) == (APPROACH, pytest.approx(SPEED))

    def test_does_not_go_over_where_the_lane_ends_too_soon(self):
        assert cutting_in(369.0, other(354.0)).phase == MANOEUVRE
        assert cutting_in(371.0, other(356.0)).phase == APPROACH

    def test_stays_with_the_vehicle_it_has_chosen(self):
        plan = cutting_in(100.0, other(95.0), other(120.0))
        assert plan.target == 1
        assert plan.plan((112.0, 0.0)).target == 1  # 17.3 m away, and the other 8.6 m
        assert plan.plan((126.0, 0.0)).target == 2  # 31.2 m

    def test_is_over_on_the_last_road(self):
        assert cutting_in(100.0, other(105.0), last=0).phase == OVER

    def test_is_over_behind_the_curve(self):
        plan = cutting_in(115.0, other(100.0))
        assert plan.plan((144.0, 3.1)).phase == MANOEUVRE
        assert plan.plan((145.5, 3.1)).phase == OVER
        assert plan.speed == 0.0
        assert plan.plan((115.0, 0.0)).phase == OVER


def turning(x, *others, radius=50.0, speed=3.0, before=0.0, lanes=3):
    """Return the plan of one who is to turn from the x axis into lane 0 of the road 12.8 m to the left."""
    graph = graph_of({"there": Road([(0, 0), (200, 0)], lanes), "back": Road([(180, 12.8), (0, 12.8)], 2)})
    return Plan(x, 0.0, *others, graph=graph, task=Task(TaskKind.U_TURN, radius, lanes, before), speed=speed)


class TestUTurn:
    @pytest.mark.parametrize(
        ("car", "phase"),
        [
            (Car(148.0, 12.8, math.pi), MANOEUVRE),  # 49.7 m away
            (Car(149.0, 12.8, math.pi), FREE),  # 50.6 m
            (Car(130.0, 9.6, math.pi), MANOEUVRE),
            (Car(120.0, 3.2), FREE),  # on the own road
        ],
    )
    def test_is_triggered_from_the_other_road(self, car, phase):
        assert turning(100.0, car).phase == phase

    def test_slows_down_first(self):
        near = Car(120.0, 12.8, math.pi)
        plan = turning(100.0, near, speed=8.0, before=8.0)
        # 2 m/s^2 to the side on a circle of 6.4 m, whose Bezier curve bends by up to an eighth more.
        assert plan.phase == APPROACH
        assert math.sqrt(2.0 * 6.4 / 1.15) < plan.speed < math.sqrt(2.0 * 6.4)
        # What has triggered it need not stay.
        plan.made.world.vehicles.alive[0, 1] = False
        plan.made.world.vehicles.speed[0, 0] = 3.5
        assert plan.plan((110.0, 0.0)).phase == MANOEUVRE
        assert (plan.lane, plan.s) == (3, pytest.approx(70.0))

    def test_does_not_cross_a_median(self):
        # 3.2 m wide, where the third lane is otherwise.
        assert turning(100.0, Car(120.0, 12.8, math.pi), lanes=2).phase == FREE

    @pytest.mark.parametrize("width", [15.0, 40.0])
    def test_turns_where_the_median_has_a_break(self, width):
        ways = {"there": Road([(0, 0), (200, 0)], 3), "back": Road([(200, 12.8), (0, 12.8)])}
        graph = graph_of({**ways, "middle": Road([(80, 9.6), (80 + width, 9.6)])})
        task = Task(TaskKind.U_TURN, 200.0, 3, 0.0)
        plan = Plan(20.0, 0.0, Car(80.0, 12.8, math.pi), graph=graph, task=task, speed=13.9)
        x, speed = 20.0, 13.9
        while plan.phase != MANOEUVRE and x < 150.0:
            plan.made.world.vehicles.speed[0, 0] = speed
            plan.plan((x, 0.0))
            # It brakes with 2 m/s^2.
            speed = max(speed - 0.2, min(plan.speed or 13.9, speed + 0.2))
            x += 0.1 * speed
        assert plan.phase == MANOEUVRE
        # The curve swings out by less than 7 m before it is across.
        assert 73.0 < x < 80.0 + width


NODES = '<nodes><node id="west" x="0" y="0"/><node id="east" x="600" y="0"/></nodes>'
EDGES = (
    '<edges><edge id="there" from="west" to="east" numLanes="3" speed="13.89"/>'
    '<edge id="back" from="east" to="west" numLanes="3" speed="13.89"/></edges>'
)
STAYS = t.LaneChangingModel(strategic=0, speed_gain=0, keep_right=0, cooperative=0)
SLOW = t.TrafficActor("slow", max_speed=6, lane_changing_model=STAYS)


def drive(folder, mission, trip, steps, action=ActionSpaceType.Lane, values=(LaneAction.keep_lane,)):
    """Return a record of the steps of one episode on a road of three lanes each way, and its outcome.

    Each step's is x, y [m], lane, phase of the guidance, x of the other vehicle [m].
    """
    (folder / "map.nod.xml").write_text(NODES)
    (folder / "map.edg.xml").write_text(EDGES)
    scenario = t.Scenario(traffic={"one": t.Traffic(flows=[], trips=[trip])}, ego_missions=[mission])
    parts = assemble([build_described(folder, scenario)], [AgentInterface(action=action)])
    starts = (parts.schedule.start(0, episode) for episode in range(2))
    parts.simulation.reset({0: next(start for start in starts if start.traffic_name == "one")})
    world, rows, log = parts.scene.world, np.ones(1, np.bool_), []
    for step in range(steps):
        parts.actions.given[:], parts.actions.fresh[:] = step > 0, step % 5 == 1
        parts.actions.values[0, 0, : len(values)] = values
        frame = parts.simulation.step(parts.actions, rows, np.ones((1, 1), np.bool_))
        if frame.events.finished[0]:
            break
        own = int(world.agents.slot[0, 0])
        rest = [slot for slot in np.flatnonzero(world.vehicles.alive[0]).tolist() if slot != own]
        beyond = world.vehicles.position[0, rest[0], 0] if rest else math.nan
        place = world.vehicles.position[0, own].tolist()
        log.append((*place, world.vehicles.lane[0, own], world.guidance.phase[0, 0], beyond))
    outcome = Outcome(int(world.agents.outcome[0, 0]))
    parts.simulation.close()
    return np.array(log), outcome


@pytest.mark.parametrize(
    ("action", "values"),
    [
        (ActionSpaceType.Lane, (LaneAction.keep_lane,)),
        pytest.param(ActionSpaceType.LaneWithContinuousSpeed, (13.0, 0.0), marks=pytest.mark.nightly),
    ],
)
def test_an_agent_that_keeps_its_lane_cuts_in(tmp_path, action, values):
    mission = t.Mission(t.Route(("there", 1, 20), ("there", 0, 580)), task=t.CutIn())
    trip = t.Trip("slow", t.Route(("there", 0, 90), ("there", 0, "max")), actor=SLOW)
    log, _ = drive(tmp_path, mission, trip, 260, action, values)
    x, y, _, phase, other_x = log.T
    assert np.unique(phase).tolist() == [FREE, APPROACH, MANOEUVRE, OVER]
    assert (np.diff(phase) >= 0).all()
    # It has not been within 30 m of the other before, and is then. Its lane's middle is y = -4.8.
    triggered = int(np.argmax(phase == APPROACH))
    apart = np.hypot(other_x - x, 3.2)
    assert apart[:triggered].min() > 30.0 >= apart[triggered]
    assert np.abs(y[phase <= APPROACH] + 4.8).max() < 0.1
    # It ends in the other's lane, in front of it, having left its own after it had passed the other.
    assert x[phase == MANOEUVRE][0] - other_x[phase == MANOEUVRE][0] == pytest.approx(15.0, abs=1.6)
    over = int(np.argmax(phase == OVER))
    assert y[over] == pytest.approx(-8.0, abs=0.3)
    assert 10.0 < x[over] - other_x[over] < 25.0
    assert np.abs(y[over:] + 8.0).max() < 0.3


@pytest.mark.parametrize("index", [2, *(pytest.param(each, marks=pytest.mark.nightly) for each in (0, 1))])
def test_an_agent_that_keeps_its_lane_turns_round(tmp_path, index):
    task = t.UTurn(trigger_radius=60, initial_speed=8.0, target_lane_index=index)
    mission = t.Mission(t.Route(("there", 0, 150), ("back", index, 550)), task=task)
    trip = t.Trip("oncoming", t.Route(("back", 2, 300), ("back", 2, "max")), actor=SLOW)
    log, outcome = drive(tmp_path, mission, trip, 500)
    x, y, lane, phase, other_x = log.T
    assert np.unique(phase).tolist() == [FREE, APPROACH, MANOEUVRE, OVER]
    triggered = int(np.argmax(phase == APPROACH))
    # The lanes' middles are y = -8 here, 1.6 where the other drives, and 8 - 3.2 index over there.
    apart = np.hypot(other_x - x, 9.6)
    assert apart[:triggered].min() > 60.0 >= apart[triggered]
    assert np.diff(x[:triggered]) == pytest.approx(0.8, abs=0.02)
    assert np.abs(y[phase <= APPROACH] + 8.0).max() < 0.1
    over = int(np.argmax(phase == OVER))
    assert y[over] == pytest.approx(8.0 - 3.2 * index, abs=0.5)
    assert lane[over] == index  # the lanes of "back" are the map's first
    # Into lane 2 it turns on 4.8 m, which is near its lock.
    assert np.abs(y[over + 20 :] - (8.0 - 3.2 * index)).max() < 0.5
    assert y[-1] == pytest.approx(8.0 - 3.2 * index, abs=0.1)
    assert outcome == Outcome.GOAL


def test_a_turn_over_a_median_is_refused(tmp_path):
    # The roads' begins and ends are 6 m off the middle.
    (tmp_path / "map.nod.xml").write_text(NODES)
    edges = EDGES.replace('"there"', '"there" shape="0,-6 600,-6"')
    (tmp_path / "map.edg.xml").write_text(edges.replace('"back"', '"back" shape="600,6 0,6"'))
    mission = t.Mission(t.Route(("there", 2, 150), ("back", 0, 550)), task=t.UTurn())
    with raises(ScenarioError, "ego_missions[0].task", values=["'there'", "'back_0'"]):
        build_described(tmp_path, t.Scenario(ego_missions=[mission]))
