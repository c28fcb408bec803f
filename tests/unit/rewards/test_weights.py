"""What drives are worth: the order of the endings, and that nothing can be gained by standing about."""

import math

import numpy as np
import pytest

from smarts.errors import ScenarioError
from smarts.geometry.binding import bind
from smarts.observations.context import AdapterContext
from smarts.rewards.kernel import near_traffic
from smarts.rewards.weights import Rewards, RewardWeights, reward_weights
from smarts.roads.scene import Scene
from smarts.types.actions import ActionSpaceType
from smarts.types.events import TRUNCATING, Contacts, Event, Events, Outcome
from smarts.types.frame import Frame, Readings
from smarts.types.mission import AgentMission, GoalKind
from tests.maps import straight
from tests.raising import raises
from tests.worlds import Car, world_of

DISCOUNT = 0.99
ROUTE = 200.0
DRIVER = Car(50.0, 0.0, speed=10.0)
REST = 40
"""Decisions after which a vehicle at rest is ended."""


class Drive:
    """One agent whose progress and end are dictated."""

    def __init__(
        self,
        weights: str | RewardWeights = "benchmark",
        horizon=120,
        goal=GoalKind.POSITION,
        period=5,
        length=0.0,
        begins=None,
    ):
        mission = AgentMission(route=("road",), goal=goal, goal_position=(ROUTE, 0.0), route_length=length)
        made = world_of([Car(0.0, 0.0, mission=mission)], maps=[straight(length=ROUTE + 50)])
        self.world = made.world
        made_scene = Scene(self.world, made.atlas, made.routes)
        self.served = AdapterContext(
            made_scene,
            ("a",),
            np.zeros(1, np.int32),
            ActionSpaceType.Lane,
            period,
            max_steps=horizon * period,
        )
        self.rewards = Rewards(self.served, weights)
        self.period = period
        self.events = Events.allocate(*self.world.agents.state.shape)
        self._settle(ROUTE if begins is None else begins)

    def decide(self, remaining, outcome=Outcome.NONE, events=Event.NONE, in_step=4):
        """Make a decision that leads to `remaining` metres; events and the end are in one of its steps."""
        for step in range(self.period):
            ends = step == in_step and outcome != Outcome.NONE
            self.events.bits[0, 0] = events if step == in_step else Event.NONE
            self.events.just_done[0, 0] = ends
            self.events.terminated[0, 0] = ends and outcome not in TRUNCATING
            self.events.truncated[0, 0] = ends and outcome in TRUNCATING
            if ends:
                self.world.agents.outcome[0, 0] = outcome
                return self._settle(remaining)
            self._settle(remaining, is_last=step == self.period - 1)
        return float(self.rewards.values[0, 0])

    def _settle(self, remaining, is_last=True):
        self.world.agents.remaining[0, 0] = remaining
        self.world.vehicles.position[0, 0] = ROUTE - remaining, 0.0
        worlds, agents = shape = self.world.agents.state.shape
        contacts = Contacts.allocate(worlds, agents, self.world.vehicles.capacity)
        rows, observe_mask = np.ones(1, np.bool_), np.ones(shape, np.bool_)
        frame = Frame(self.world, rows, None, None, contacts, self.events, observe_mask, Readings({}, {}))
        self.rewards.collect(frame, is_last)
        return float(self.rewards.values[0, 0])


def discounted(rewards):
    return sum(reward * DISCOUNT**k for k, reward in enumerate(rewards))


def drive(decisions, outcome, horizon, progress=1.0, weights="benchmark"):
    """Return the discounted return of a steady drive over a share of the route, with an end."""
    one = Drive(weights, horizon=horizon)
    left = [ROUTE * (1 - progress * (k + 1) / decisions) for k in range(decisions)]
    return discounted(
        one.decide(remaining, outcome if k == decisions - 1 else Outcome.NONE)
        for k, remaining in enumerate(left)
    )


def test_creeping_does_not_pay_in_version_1():
    def v1(decisions, outcome, progress=1.0):
        return drive(decisions, outcome, 120, progress, "v1")

    fast, creeping = v1(40, Outcome.GOAL), v1(100, Outcome.GOAL)
    waiting = v1(120, Outcome.TIME_OUT, progress=0.5)
    parked = v1(REST, Outcome.NOT_MOVING, progress=0.0)
    crash = v1(15, Outcome.COLLISION, progress=0.4)
    late_crash = v1(100, Outcome.COLLISION, progress=0.9)
    assert fast > creeping > waiting > max(crash, late_crash)
    assert creeping > parked > max(crash, late_crash)
    # With a crash in ten drives, driving is still worth more than creeping without any.
    assert 0.9 * fast + 0.1 * crash > creeping + 0.3


@pytest.mark.parametrize("outcome", [Outcome.GOAL, Outcome.COLLISION])
def test_progress_telescopes_to_one_however_it_ends(outcome):
    one = Drive(reward_weights(time=0.0, goal=0.0, collision=0.0, off_route=0.0))
    rewards = [one.decide(remaining) for remaining in (170.0, 180.0, 90.0)] + [one.decide(60.0, outcome)]
    assert discounted(rewards) == pytest.approx(1.0, abs=1e-6)


def test_a_lane_change_that_is_due_pays_back_what_it_cost():
    one = Drive(reward_weights(progress=0.0, time=0.0, goal=0.0, lane_change=-0.2))
    due = one.world.agents.lane_changes
    rewards = []
    for changes in (1, 2, 0, -1, 100):
        due[0, 0] = changes
        rewards.append(one.decide(ROUTE))
    np.testing.assert_allclose(
        rewards, [-0.99 * 0.2, -0.99 * 0.4 + 0.2, 0.4, -0.99 * 0.2, -0.99 * 0.6 + 0.2], atol=1e-6
    )
    # From no change due to the end: the potential leaves nothing behind, however the episode ends.
    assert discounted([*rewards, one.decide(ROUTE, Outcome.MISSED_GOAL) + 1.0]) == pytest.approx(
        0.0, abs=1e-6
    )


def test_an_ending_counts_once_whatever_the_step():
    for step in range(5):
        one = Drive(reward_weights(progress=0.0, time=0.0))
        assert one.decide(100.0, Outcome.COLLISION, Event.COLLISION, in_step=step) == pytest.approx(-2.0)


def test_a_collision_that_does_not_end_the_episode_costs_once_a_decision():
    one = Drive(reward_weights(progress=0.0, time=0.0))
    assert one.decide(100.0, events=Event.COLLISION, in_step=1) == pytest.approx(-2.0)
    assert one.decide(90.0) == 0.0


def test_metres_of_the_route():
    one = Drive("route_metres", period=1)
    assert [one.decide(left, in_step=0) for left in (197.5, 190.0)] == pytest.approx([2.5, 7.5])


def test_the_papers_reward():
    one = Drive("paper", period=1)
    reward = one.decide(198.0, in_step=0)
    assert reward == pytest.approx(0.5 + 0.05 * 2.0 - 0.01 * 198.0 + 0.1 * 2.0)
    crash = one.decide(198.0, Outcome.COLLISION, Event.COLLISION, in_step=0)
    assert crash == pytest.approx(0.5 - 0.01 * 198.0 - 50.0)


def near(*others, own=DRIVER):
    """Return mean distance and mean time to collision of the vehicles near one."""
    made = world_of([own, *others], maps=[straight(length=400.0)], capacity=16)
    return bind(near_traffic, made.world.vehicles)(0, 0, np.empty(8, np.int32), np.empty(8))


def test_distance_and_time_to_a_vehicle_that_comes_nearer():
    # 20 m ahead and 5 m/s slower: 4 s. One beside drives as fast: never.
    ahead, beside = Car(70.0, 0.0, speed=5.0), Car(50.0, 6.4, speed=10.0)
    assert near(ahead) == pytest.approx(((7 * 50 + 20) / 8, (7 * 5 + 4) / 8))
    assert near(ahead, beside) == pytest.approx(((6 * 50 + 20 + 6.4) / 8, (7 * 5 + 4) / 8))


def test_oncoming_and_crossing_vehicles():
    oncoming = Car(90.0, 0.0, math.pi, 10.0)
    assert near(oncoming)[1] == pytest.approx((7 * 5 + 2) / 8)
    crossing = Car(50.0, -30.0, math.pi / 2, 15.0)
    assert near(crossing, own=Car(50.0, 0.0))[1] == pytest.approx((7 * 5 + 2) / 8)
    sliding = near(oncoming, own=Car(90.0, 30.0, speed=10.0))
    assert sliding[1] == 5.0


def test_neighbours_and_steering_are_weighed():
    one = Drive(reward_weights("paper", each_step=0.0, metres=0.0, goal_distance=0.0, approach=0.0), period=1)
    assert one.decide(ROUTE, in_step=0) == 0.0
    slot = one.world.vehicles
    slot.alive[0, 5], slot.position[0, 5] = True, (30.0, 0.0)
    # A standing vehicle appears 30 m ahead of a standing vehicle.
    assert one.decide(ROUTE, in_step=0) == pytest.approx(-0.03 * 20 / 8)
    slot.speed[0, 0] = 20.0
    one.world.agents.steering[0, 0] = 0.3
    hard = -0.1 * ((72 - 60) / 20 * 0.3 / 4) ** 2
    assert one.decide(ROUTE, in_step=0) == pytest.approx(-0.01 * (5 - 1.5) / 8 + hard, rel=1e-5)


def test_the_discount_may_be_the_learners():
    one = Drive(reward_weights(time=0.0))
    one.rewards = Rewards(one.served, reward_weights(time=0.0), discount=0.9)
    one._settle(ROUTE)
    assert one.decide(100.0) == pytest.approx(0.9 * -0.5 + 1.0)
    Rewards(one.served, "benchmark", discount=np.float32(0.9))
    with raises(ScenarioError, "reward", values=[1.5]):
        Rewards(one.served, "benchmark", discount=1.5)


def test_who_begins_off_its_route_is_not_fined_for_getting_there():
    one = Drive(reward_weights(time=0.0), length=ROUTE, begins=0.0)
    # Off the route nothing remains, so that the potential there is 0 of the whole route, not of one metre.
    assert one.decide(50.0) == pytest.approx(0.99 * -0.25)


def test_what_counts_for_each_step_counts_for_all_of_a_decision():
    alone = {"each_step": 0.0, "metres": 0.0, "approach": 0.0, "hard_steering": 0.0, "goal_distance": 0.0}
    for term, worth in (("each_step", 0.5), ("goal_distance", -0.01 * 150.0)):
        weights = reward_weights("paper", **{**alone, term: reward_weights("paper").__dict__[term]})
        assert Drive(weights, period=5).decide(150.0) == pytest.approx(5 * worth, rel=1e-6)
    one = Drive(reward_weights("paper", **{**alone, "hard_steering": -0.1}), period=5)
    one.world.vehicles.speed[0, 0], one.world.agents.steering[0, 0] = 20.0, 0.3
    assert one.decide(150.0) == pytest.approx(5 * -0.1 * ((72 - 60) / 20 * 0.3 / 4) ** 2, rel=1e-5)


def test_the_wrong_way_and_the_shoulder_cost_even_in_the_last_decision():
    for event, weights in (
        (Event.WRONG_WAY, RewardWeights(goal=1.0, wrong_way=-0.3)),
        (Event.ON_SHOULDER, RewardWeights(goal=1.0, on_shoulder=-0.3)),
    ):
        both = event | Event.REACHED_GOAL
        assert Drive(weights).decide(0.0, Outcome.GOAL, both) == pytest.approx(0.7)
