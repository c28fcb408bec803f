"""Drivers that plan: frames of lanes, manoeuvres in simulations, and what happens when planning fails."""

import math
from contextlib import closing

import numpy as np
import pytest

from smarts.agents import ActionSpaceType, AgentInterface, DoneCriteria
from smarts.controllers.action_formats import PATH_POINTS
from smarts.controllers.tracking import SPEED_GAIN
from smarts.dynamics import vehicle
from smarts.dynamics.performance import Abilities
from smarts.env.vector import VectorHiWayEnv
from smarts.observations.lane_ways import BEHIND, LANE_WAYS, POINTS
from smarts.observations.nearby import NEARBY
from smarts.observations.surroundings import Lane, Own
from smarts.observations.u_turn import POINTS as TURN_POINTS
from smarts.observations.u_turn import TURN_LANE, TURN_STATE
from smarts.planners import PlanStatus, resample
from smarts.providers.vehicle import TYPES
from smarts.types.agent_states import AgentStatus
from smarts.zoo import make_agent
from smarts.zoo.lane_frames import to_lane, to_map
from smarts.zoo.planned import agilities, neighbours_of, plan_paths
from tests.faulty_planner import Faulty

from .batches import batch_of, seen_of, two_lanes, with_ways

RADIUS = 50.0
BRAKES = np.ones((1, 1, 1), int)
"""The ego's action."""


def arc():
    """Return a lane that turns left on a circle around (0, RADIUS); the vehicle is beside (0, 0)."""
    angle = (np.arange(POINTS) - BEHIND) * 2.0 / RADIUS
    return np.column_stack([RADIUS * np.sin(angle), RADIUS * (1.0 - np.cos(angle)), angle])[None]


@pytest.mark.parametrize(("station", "offset", "turn"), [(0, 0, 0), (33.3, 3.2, 0.1), (-12.0, -3.2, -0.2)])
def test_poses_in_the_frame_of_a_lane(station, offset, turn):
    angle = station / RADIUS
    radius = RADIUS - offset
    pose = [radius * math.sin(angle), RADIUS - radius * math.cos(angle), angle + turn]
    found = to_lane(arc(), np.array([[pose]]))
    np.testing.assert_allclose(found[0, 0], [station, offset, turn], atol=0.07)
    np.testing.assert_allclose(to_map(arc(), found)[0, 0], pose, atol=0.05)


def test_neighbours_keep_their_lane_on_a_bend():
    """One 20 m ahead in the lane to the left, at 10 m/s, is 20 + 10 * 50 / 46.8 m ahead a second later."""
    angle, radius = 20.0 / RADIUS, RADIUS - 3.2
    nearby = np.zeros((1, 2, 6))
    nearby[0, 0] = radius * math.sin(angle), RADIUS - radius * math.cos(angle), angle, 10.0, 12.0, 2.5
    own = np.zeros((1, 15))
    own[0, 4:6] = 8.0, 2.0
    found = neighbours_of(arc(), nearby, own)
    later = resample(found.path[0, :1], np.array([[1.0]]))[0, 0]
    np.testing.assert_allclose(later, [1.0, 30.684, 3.2, 0.0, 10.684], atol=0.05)
    assert np.isnan(found.path[0, 1]).all()
    assert found.size[0, 0].tolist() == [15.0, 2.5], "a vehicle of 8 m instead of 5 m needs 3 m more"


def test_plans_ask_for_the_acceleration_that_the_controller_makes_of_lacking_speed():
    times = np.linspace(0.0, 2.0, 21)
    paths = np.zeros((2, 21, 5))
    paths[:, :, 0] = times
    paths[0, :, 4], paths[1, :, 4] = 10.0 + 1.2 * times, 10.0 - 1.2 * times
    actions = plan_paths(paths)
    assert actions.shape == (2, 4, PATH_POINTS)
    assert SPEED_GAIN * (actions[0, 3, :20] - paths[0, :20, 4]) == pytest.approx(1.2)
    assert actions[1, 3, :21] == pytest.approx(paths[1, :, 4]), "for braking it looks ahead"


@pytest.mark.parametrize("planner", ["bezier", "receding_horizon"])
def test_a_half_circle_leads_into_its_lane_without_turning_back(planner):
    """The receding horizon ends up to 1 m beyond the first point of the lane."""
    batch = batch_of(seen_of(speed=3.4, allowed=10.0))
    batch.observations[LANE_WAYS] = np.zeros((1, 3, POINTS, 3))
    batch.observations[LANE_WAYS][..., 0] = 2.0 * (np.arange(POINTS) - BEHIND)
    lane = [[-2.0 * point, 9.6, math.pi] for point in range(TURN_POINTS)]
    more = {TURN_LANE: np.array([lane]), TURN_STATE: np.array([[2.9, np.inf, 0.0]])}
    agent = make_agent("u-turn-v0", planner=planner)[0]
    path = agent.act(batch._replace(observations={**batch.observations, **more}))[0]
    steps = np.diff(path[:2].T, axis=0)
    assert path[:2, -1].tolist() == lane[-1][:2]
    assert (steps[1:] * steps[:-1]).sum(axis=1).min() > 0.0


def bend(radius, way=0.0, speed=10.0, beside=False):
    """Return what a vehicle sees in a bend to the right around the origin, behind a slow leader.

    Args:
        radius: Of its lane [m]; the free one to its left has 3.2 m more.
        way: How far it has come [m].
        speed: [m/s]
        beside: Whether its planner sees a queue to its left.
    """
    angle, ways, nearby = -way / radius, np.zeros((1, 3, POINTS, 3)), np.zeros((1, 8, 6))
    for lane, own in enumerate((radius, radius + 3.2)):
        angles = angle - (np.arange(POINTS) - BEHIND) * 2.0 / own
        ways[0, lane] = np.column_stack([own * np.cos(angles), own * np.sin(angles), angles - 0.5 * math.pi])
    if beside:
        nearby[0, :3, :3] = ways[0, 1, [BEHIND - 6, BEHIND, BEHIND + 6]]
        nearby[0, :3, 3:] = speed, 5.0, 2.0
    seen = two_lanes()
    seen.own[0, [Own.X, Own.Y, Own.HEADING]], seen.own[0, Own.SPEED] = ways[0, 0, BEHIND], speed
    batch = batch_of(seen, step=round(10.0 * way / speed), is_first=way == 0.0)
    return batch._replace(observations={**batch.observations, LANE_WAYS: ways, NEARBY: nearby})


@pytest.mark.parametrize("steps", [79, 100])
def test_a_lane_change_leads_to_its_lane_however_late(steps):
    """A queue blocks it until just before it is given up, or longer: then it is tried again."""
    agent = make_agent("overtaking-v0", planner="tests.faulty_planner:Waiting")[0]
    for step in range(steps):
        paths = agent.act(bend(RADIUS, float(step), beside=True))
        assert np.hypot(*paths[0, :2]) == pytest.approx(RADIUS, abs=0.5)
    paths = [agent.act(bend(RADIUS, float(step)))[0] for step in (steps, steps + 1)]
    assert math.hypot(*paths[-1][:2, -1]) == pytest.approx(RADIUS + 3.2, abs=0.5)


def test_lane_changes_in_bends_are_slow():
    """The lateral acceleration in the other lane is at most 3 m/s^2."""
    radius = 20.0
    agent = make_agent("overtaking-v0")[0]
    path = agent.act(bend(radius, speed=12.0))[0]
    assert math.hypot(*path[:2, -1]) > radius + 1.6, "it changes lanes"
    assert path[3].max() <= 1.02 * math.sqrt(3.0 * (radius + 3.2))


def test_lane_changes_on_fast_roads():
    agent = make_agent("overtaking-v0")[0]
    seen = seen_of(speed=25.0, allowed=25.0, demanded=-1.0)
    seen.lanes[:, 2, Lane.OPEN], seen.lanes[:, 0, Lane.LEFT] = 1.0, 300.0
    path = agent.act(with_ways(batch_of(seen)))[0]
    assert path[1, -1] == pytest.approx(-3.2, abs=0.5)
    assert path[3].min() > 24.0


def test_vehicles_keep_the_agility_of_their_kind():
    known = [*TYPES]
    lengths = np.array([vehicle(kind.name.lower()).length for kind in known])
    assert agilities(lengths + 0.05).tolist() == Abilities.of_all().agility[known].tolist()


class Listener:
    """Keeps of each frame which agents have failed, and where the social agent's vehicle is."""

    def __init__(self):
        self.failures, self.places, self.given = [], [], []

    def collect(self, frame, is_last):
        if frame.actions is not None:
            self.failures.append(dict(frame.social_failures))
            slot = frame.world.agents.slot[0, 1]
            self.places.append(frame.world.vehicles.position[0, slot].copy())
            self.given.append(bool(frame.actions.given[0, 1]))

    def reset(self, egos):
        pass


def overtake(monkeypatch, failing):
    """Let a social agent overtake by a planner that fails at times; return frames and statuses of plans."""
    monkeypatch.setattr(Faulty, "failing", failing)
    monkeypatch.setattr(Faulty, "plans", [])
    social = [{"agent": "overtaking-v0", "options": {"planner": "tests.faulty_planner:Faulty"}}]
    never = DoneCriteria(collision=False, off_road=False, off_route=False)
    ego = AgentInterface(action=ActionSpaceType.Lane, vehicle_model="kinematic", done_criteria=never)
    listener = Listener()
    with closing(VectorHiWayEnv(1, ["overtaking"], {"ego": ego}, social_agents=social)) as env:
        env._runner.listen(listener)
        env.reset(1)
        while not any(listener.failures) and len(Faulty.plans) <= max(8, len(failing)):
            env.step(BRAKES)
        assert env._runner.world.agents.state[0, 1] == AgentStatus.ACTIVE
        for _ in range(20):
            env.step(BRAKES)
    return listener, [int(each.status[0]) for each in Faulty.plans]


def test_while_planning_fails_the_last_plan_is_driven(monkeypatch):
    failing = range(3, 6)
    listener, statuses = overtake(monkeypatch, failing)
    assert [number for number, status in enumerate(statuses) if status] == [*failing]
    assert {statuses[number] for number in failing} == {PlanStatus.SHIFTED}
    assert not any(listener.failures)


def test_when_the_last_plan_is_over_the_fallback_drives_in_the_same_step(monkeypatch):
    listener, statuses = overtake(monkeypatch, range(3, 40))
    assert statuses[:3] == [PlanStatus.PLANNED] * 3
    assert {*statuses[3:-1]} == {PlanStatus.SHIFTED}
    assert statuses[-1] == PlanStatus.FAILED, "it is not asked again"
    (failed,) = [step for step, each in enumerate(listener.failures) if each]
    assert [*listener.failures[failed]] == [(0, 1)]
    assert "cannot act" in listener.failures[failed][0, 1]
    assert listener.given[failed - 1]
    assert not listener.given[failed], "the fallback drives in this step"
    ways = np.hypot(*np.diff(listener.places, axis=0).T)
    assert (ways[failed - 3 : failed + 3] > 0.2).all()
    assert np.abs(np.diff(ways[failed - 5 : failed + 10])).max() < 0.1, "no jump of the speed above 10 m/s^2"
