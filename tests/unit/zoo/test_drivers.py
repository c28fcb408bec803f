"""The zoo's drivers against their equations, and in simulations."""

import math

import numpy as np
import pytest

from benchmark.running.zoo_contract import ZooDrive
from smarts.agents.policy import BatchAgent
from smarts.agents.spec import AgentSpec
from smarts.errors import SmartsError
from smarts.observations.surroundings import Lane, Own
from smarts.types.traffic import Signal
from smarts.zoo import make_agent, make_spec
from smarts.zoo.agents.idm import IdmDriver
from smarts.zoo.agents.keep_lane import NonInteractive
from smarts.zoo.agents.mobil import MobilDriver
from smarts.zoo.driving import DRIVER, HARDEST, LINE_OVERLAP, Idm, Seen

from .batches import batch_of, seen_of, two_lanes, with_ways


def equilibrium_gap(model, speed, desired):
    """The gap at which a follower keeps its leader's speed: Treiber, Hennecke, Helbing 2000, eq. 5."""
    return (model.min_gap + speed * model.tau) / math.sqrt(1.0 - (speed / desired) ** 4)


@pytest.mark.parametrize("speed", [0.0, 3.0, 8.0, 13.0])
def test_at_the_equilibrium_gap_nothing_changes(speed):
    model = Idm(tau=1.5, accel=1.2, decel=2.5, min_gap=3.0)
    gap = equilibrium_gap(model, speed, 15.0)
    assert model.acceleration(speed, 15.0, gap, speed) == pytest.approx(0.0, abs=1e-12)
    assert model.acceleration(speed, 15.0, gap + 1.0, speed) > 0.0
    assert model.acceleration(speed, 15.0, gap - 1.0, speed) < 0.0


def test_the_equation_by_hand():
    model = Idm(tau=1.0, accel=2.0, decel=2.0, min_gap=2.0)
    # s* = 2 + 10 + 10 * 4 / 4 = 22, and the free term is 1 - (1/2)^4.
    assert model.acceleration(10.0, 20.0, 44.0, 6.0) == pytest.approx(2.0 * (15.0 / 16.0 - 0.25))
    assert model.acceleration(10.0, 20.0, 0.0, 0.0) == -HARDEST
    assert model.acceleration(0.0, 20.0, np.inf, 0.0) == 2.0


class Convoy(BatchAgent):
    """Egos behind one that drives at a constant speed: it is the last one."""

    interface = DRIVER
    observation = ("surroundings", "speed")

    def __init__(self, speed, followers):
        self._leader, self._followers = NonInteractive(speed), followers

    def act(self, obs):
        actions = self._followers.act(obs)
        is_leader = obs.agent_id == 3
        actions[is_leader] = self._leader.act(obs)[is_leader]
        return actions


def world_of(drive):
    """Return the arrays of a drive's simulation."""
    return drive.env._env.runner.world


def test_requests_have_the_mask_of_the_world():
    agent, spec = IdmDriver(), AgentSpec(DRIVER, IdmDriver)
    with ZooDrive(spec, agent, "loop", egos=2, traffic="no_social_vehicles") as drive:
        drive.reset()
        for _ in range(3):
            wanted = world_of(drive).agents.action_mask[0, :2].copy()
            batch, _ = drive.step()
            np.testing.assert_array_equal(batch.action_mask, wanted)
        assert not wanted.all()


def convoy(speed, steps, followers=None):
    """Yield gaps and speeds of four vehicles in a row, the leader last."""
    followers = followers or IdmDriver()
    agent = Convoy(speed, followers)
    spec = AgentSpec(DRIVER, lambda: agent)
    with ZooDrive(spec, agent, "two_way@platoon", egos=4, traffic="no_social_vehicles") as drive:
        drive.reset()
        for _ in range(steps):
            drive.step()
            if len(drive.active) < 4:
                break
            world = world_of(drive)
            vehicles, slots = world.vehicles, world.agents.slot[0, :4]
            x = vehicles.position[0, slots, 0]
            yield np.abs(np.diff(x)) - vehicles.length[0, slots[0]], vehicles.speed[0, slots]
        assert "collision" not in drive.outcomes.values()


def test_a_convoy_keeps_the_gaps_of_the_equation():
    gaps, speeds = [*convoy(5.0, 350)][-1]
    assert speeds == pytest.approx(5.0, abs=0.05)
    desired = 13.9
    assert gaps == pytest.approx(equilibrium_gap(Idm(), 5.0, desired), abs=0.35)


@pytest.mark.parametrize("name", ["idm-v0", "boids-v0"])
def test_vehicles_stop_behind_one_that_stands(name):
    followers = make_agent(name)[0]
    gaps, speeds = [*convoy(0.0, 250, followers)][-1]
    assert speeds == pytest.approx(0.0, abs=0.1)
    assert gaps.min() > 0.5 * followers.model.min_gap
    assert gaps.max() < followers.model.min_gap + 2.0


def test_red_lights_ends_of_lanes_and_others_at_junctions_stop_a_driver():
    driver = IdmDriver()
    wanted = driver.model.acceleration(8.0, 14.0, 20.0, 0.0)
    free = driver.model.acceleration(8.0, 14.0, np.inf, 0.0)
    for changes in ({"light": Signal.STOP, "light_gap": 20.0}, {"yield_gap": 20.0 - LINE_OVERLAP}):
        assert driver.follow(seen_of(speed=8.0, allowed=14.0, **changes)) == pytest.approx(wanted)
    for light in (Signal.GO, Signal.NONE):
        seen = seen_of(speed=8.0, allowed=14.0, light=light, light_gap=20.0)
        assert driver.follow(seen) == pytest.approx(free)
    for column in (Lane.LEFT, Lane.END):
        seen = seen_of(speed=8.0, allowed=14.0)
        seen.lanes[0, 0, column] = 20.0
        stops = driver.follow(seen, keeps_to_route=column == Lane.LEFT)
        assert stops == pytest.approx(wanted)


@pytest.mark.parametrize(("speed", "stops"), [(8.0, True), (14.0, False)])
def test_at_an_amber_light_a_driver_stops_if_it_can(speed, stops):
    driver = IdmDriver()
    seen = seen_of(speed=speed, allowed=14.0, light=Signal.CAUTION, light_gap=20.0)
    assert (driver.follow(seen)[0] < -1.0) == stops


def test_the_incentive_of_mobil_by_its_equation():
    driver = MobilDriver(politeness=0.5)
    model, seen = driver.model, two_lanes()
    seen.lanes[:, 0, [Lane.BEHIND, Lane.BEHIND_SPEED, Lane.BEHIND_DESIRED]] = 15.0, 9.0, 12.0
    seen.lanes[:, 1, [Lane.AHEAD, Lane.AHEAD_SPEED]] = 60.0, 12.0
    seen.lanes[:, 1, [Lane.BEHIND, Lane.BEHIND_SPEED, Lane.BEHIND_DESIRED]] = 25.0, 11.0, 14.0
    own = model.acceleration(10.0, 14.0, 60.0, 12.0) - model.acceleration(10.0, 14.0, 20.0, 5.0)
    old = model.acceleration(9.0, 12.0, 40.0, 5.0) - model.acceleration(9.0, 12.0, 15.0, 10.0)
    new = model.acceleration(11.0, 14.0, 25.0, 10.0) - model.acceleration(11.0, 14.0, 90.0, 12.0)
    gained = driver.incentive(seen, np.array([1], np.int32))
    assert gained == pytest.approx(own + 0.5 * (old + new))


def test_mobil_changes_to_the_faster_lane_unless_it_makes_others_brake():
    seen = two_lanes()
    assert MobilDriver().act(batch_of(seen))[0, 1] == 1.0
    assert MobilDriver(threshold=10.0).act(batch_of(seen))[0, 1] == 0.0
    assert MobilDriver().act(batch_of(seen, mask=False))[0, 1] == 0.0
    seen.lanes[:, 1, [Lane.BEHIND, Lane.BEHIND_SPEED, Lane.BEHIND_DESIRED]] = 5.0, 14.0, 14.0
    assert MobilDriver().act(batch_of(seen))[0, 1] == 0.0


def test_after_a_change_mobil_waits():
    driver, seen = MobilDriver(), two_lanes()
    assert driver.act(batch_of(seen, step=0))[0, 1] == 1.0
    assert driver.act(batch_of(seen, step=10, is_first=False))[0, 1] == 0.0
    assert driver.act(batch_of(seen, step=40, is_first=False))[0, 1] == 1.0
    assert driver.act(batch_of(seen, step=45, is_first=True))[0, 1] == 1.0, "another vehicle"


@pytest.mark.parametrize("name", ["idm-v0", "mobil-v0", "overtaking-v0", "cut-in-v0", "boids-v0"])
def test_changes_that_the_route_demands(name):
    """In time before the lane leaves the route, if there is room; and to a lane that is open."""

    def change(seen):
        """Return the side to which the vehicle drives in the end."""
        if name not in ("overtaking-v0", "cut-in-v0"):
            return driver.act(batch_of(seen))[0, 1]
        y = driver.act(with_ways(batch_of(seen)))[0, 1]
        return np.sign(np.round(y[-1]))

    driver = make_agent(name)[0]
    for left, expected in ((400.0, 0.0), (100.0, -1.0)):
        seen = seen_of(speed=10.0, allowed=14.0, demanded=-1.0)
        seen.lanes[:, 2, Lane.OPEN] = 1.0
        seen.lanes[:, 0, Lane.LEFT] = left
        assert change(seen) == expected
        seen.lanes[:, 2, Lane.BEHIND] = -2.0
        assert change(seen) == 0.0


@pytest.mark.parametrize(
    ("name", "scenario"),
    [
        ("idm-v0", "intersection"),
        ("mobil-v0", "double_merge"),
    ],
)
def test_drivers_arrive_unharmed(name, scenario):
    agent, _ = make_agent(name)
    ends = []
    with ZooDrive(make_spec(name), agent, scenario, egos=4) as drive:
        for _ in range(2):
            drive.reset()
            for _ in range(600):
                drive.step()
                if not drive.active:
                    break
            ends += drive.outcomes.values()
    assert len(ends) == 8
    assert {*ends} <= {"goal", "missed_goal"}
    if name == "idm-v0":
        assert ends.count("goal") >= 6


def test_a_u_turn_turns_round():
    spec = make_spec("u-turn-v0", planner="bezier")
    with ZooDrive(spec, spec.build_agent(), "intersection", egos=4) as drive:
        drive.reset()
        world = world_of(drive)
        first = {}
        turned = set()
        for _ in range(150):  # before the road's end
            drive.step()
            slots = world.agents.slot[0, :4]
            headings = world.vehicles.heading[0]
            for ego in (int(name.removeprefix("agent-")) for name in drive.active):
                heading = first.setdefault(ego, headings[slots[ego]])
                if math.cos(headings[slots[ego]] - heading) < -0.95:
                    turned.add(ego)
        outcomes = {*drive.outcomes.values()}
    assert turned
    assert not outcomes & {"collision", "off_road"}


def test_a_trajectory_is_played_from_where_the_vehicle_is(tmp_path):
    poses = np.column_stack([np.linspace(0.0, 30.0, 61), np.zeros(61)])
    np.savetxt(tmp_path / "poses.csv", poses, delimiter=",")
    spec = make_spec("trajectory-v0", poses=tmp_path / "poses.csv", relative=True)
    with ZooDrive(spec, spec.build_agent(), "loop", egos=1) as drive:
        drive.reset()
        vehicles, slot = world_of(drive).vehicles, world_of(drive).agents.slot[0, 0]
        begin, heading = vehicles.position[0, slot].copy(), float(vehicles.heading[0, slot])
        way = []
        for _ in range(80):
            drive.step()
            if drive.active:
                way.append(vehicles.position[0, slot] - begin)
    along = np.array(way) @ [math.cos(heading), math.sin(heading)]
    assert along[:60] == pytest.approx(0.5 * np.arange(1, 61), abs=1e-6)
    assert along[60:] == pytest.approx(30.0, abs=1e-6)
    with pytest.raises(SmartsError):
        make_agent("trajectory-v0", poses=[[0, 0, 0, 0]] * 3)


def test_boids_gather():
    """The rear one of two vehicles in different lanes of one simulation changes over and speeds up."""
    agent = make_agent("boids-v0")[0]
    seen = seen_of(2, speed=8.0, allowed=14.0)
    seen.own[1, [Own.X, Own.Y, Own.SPEED]] = 30.0, 3.2, 10.0
    seen.lanes[0, 1, Lane.OPEN] = 1.0
    actions = agent.act(batch_of(seen))
    assert actions[0].tolist()[1] == 1.0
    assert actions[0, 0] > 8.0
    assert actions[1, 0] < 10.0
    alone = agent.act(batch_of(Seen(seen.own[:1], seen.lanes[:1])))
    assert alone[0, 1] == 0.0
