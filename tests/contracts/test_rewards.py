"""Every reward of `rewards.yaml` with every kind of mission: a drive is worth more than a stand."""

import numpy as np
import pytest
import yaml

from smarts.observations.context import AdapterContext
from smarts.rewards import weights
from smarts.rewards.weights import Rewards, reward_weights
from smarts.roads.scene import Scene
from smarts.types.actions import ActionSpaceType
from smarts.types.frame import Frame, Readings
from smarts.types.mission import AgentMission, GoalKind
from tests.maps import straight
from tests.unit.sim.stage import Stage
from tests.worlds import Car

NAMES = list(yaml.safe_load(weights._FILE.read_text()))
BEGIN, STEPS, PERIOD = 20.0, 100, 5


def earned(name, mission, places):
    """Return the sum of the rewards of a vehicle that is at these places, one a step."""
    stage = Stage([Car(*places[0], speed=10.0, mission=mission)], graph=straight(1, 200.0), ending=0)
    world, made = stage.world, stage.made
    scene = Scene(world, made.atlas, made.routes)
    context = AdapterContext(
        scene, ("a",), np.zeros(1, np.int32), ActionSpaceType.Lane, PERIOD, max_steps=4 * STEPS
    )
    rewards, total = Rewards(context, name), 0.0
    observed = np.ones(world.agents.state.shape, np.bool_)

    def collect(events, is_last):
        readings = Readings({}, {})
        rewards.collect(
            Frame(world, stage.rows, None, None, stage.contacts, events, observed, readings), is_last
        )
        return float(rewards.values[0, 0]) if is_last else 0.0

    collect(stage.judge.reset(stage.contacts, stage.rows), is_last=False)
    for step, place in enumerate(places[1:], 1):
        world.step += 1
        stage.step(place)
        total += collect(stage.events, step % PERIOD == 0)
    return total


def line(y=0.0, speed=10.0):
    return [(BEGIN, 0.0)] + [(BEGIN + 0.1 * speed * k, y) for k in range(1, STEPS + 1)]


def mission_of(kind):
    if kind == GoalKind.ENDLESS:
        return AgentMission()
    return AgentMission(
        route=("road",), goal=kind, goal_position=(150.0, 0.0), goal_lane=0, goal_s=150.0, route_length=130.0
    )


@pytest.mark.parametrize("kind", GoalKind)
@pytest.mark.parametrize("name", NAMES)
def test_a_drive_earns_more_than_a_stand(name, kind):
    drive, stand = (earned(name, mission_of(kind), line(speed=speed)) for speed in (10.0, 0.0))
    assert drive > stand + 0.5


@pytest.mark.parametrize("name", NAMES)
def test_100_m_without_a_goal_are_worth_a_mission_of_100_m(name):
    drive, stand = (earned(name, AgentMission(), line(speed=speed)) for speed in (10.0, 0.0))
    own = reward_weights(name)
    assert drive - stand == pytest.approx(own.progress + own.goal + 100.0 * own.metres)


@pytest.mark.parametrize("kind", GoalKind)
def test_metres_beside_the_road_are_worth_nothing(kind):
    assert earned("route_metres", mission_of(kind), line(y=-60.0)) == 0.0
    # Nor are they when it comes back to the road for the last 30 m.
    back = line(y=-60.0)[:-30] + line()[-30:]
    assert earned("route_metres", mission_of(kind), back) == pytest.approx(29.0)
    assert earned("route_metres", mission_of(kind), line()) == pytest.approx(100.0)
