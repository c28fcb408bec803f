"""The world's books: what is now, what was, and what a reset leaves."""

import numpy as np
import pytest

from smarts.types.mission import AgentMission, GoalKind, Via
from smarts.types.world import World


@pytest.fixture
def world():
    world = World(worlds=2, capacity=4, agents=3, lanes=5, vias=2)
    world.registry.used[:] = 4  # Every slot has held a vehicle.
    return world


def snapshot(world, row):
    tables = (world.vehicles, world.before, world.agents)
    return [column[row].copy() for table in tables for column in table]


def test_advancing_remembers_and_leaves_the_present(world):
    world.vehicles.speed[:] = 3.0
    world.advance(np.array([True, True]))
    world.vehicles.speed[:] = 4.0
    assert (world.before.speed == 3.0).all()
    assert world.step.tolist() == [1, 1]
    assert world.time.tolist() == pytest.approx([0.1, 0.1])


def test_a_paused_simulation_is_left_alone(world):
    world.vehicles.speed[:] = 3.0
    before = snapshot(world, 1)
    world.advance(np.array([True, False]))
    assert all((a == b).all() for a, b in zip(before, snapshot(world, 1), strict=True))
    assert world.step.tolist() == [1, 0]
    assert (world.before.speed[0] == 3.0).all()


def test_clearing_is_as_new(world):
    new = snapshot(World(worlds=2, capacity=4, agents=3, lanes=5, vias=2), 0)
    beside = snapshot(world, 1)
    for table in (world.vehicles, world.before, world.agents):
        for column in table:
            column[0] = 1
    world.step[0] = 9
    world.clear(0)
    assert all((a == b).all() for a, b in zip(new, snapshot(world, 0), strict=True))
    assert all((a == b).all() for a, b in zip(beside, snapshot(world, 1), strict=True))
    assert world.step[0] == 0


def test_a_mission_may_have_many_vias():
    world = World(worlds=1, capacity=1, agents=1, lanes=1, vias=200)
    via = Via((5.0, 6.0), 3, 1.5, 7.0)
    world.missions.write(0, 0, AgentMission(goal=GoalKind.LAPS, vias=(via,) * 200), 0)
    assert world.missions.via_count[0, 0] == 200


def test_a_mission_is_written_whole_and_over_an_older_one(world):
    via = Via((5.0, 6.0), 3, 1.5, 7.0)
    world.missions.write(0, 1, AgentMission(goal=GoalKind.LAPS, laps=3, vias=(via, via)), 4)
    world.missions.write(
        0, 1, AgentMission(("a",), GoalKind.POSITION, (1.0, 2.0), goal_lane=3, vias=(via,)), 2
    )
    missions = world.missions
    assert (missions.goal[0, 1], missions.route[0, 1], missions.laps[0, 1]) == (GoalKind.POSITION, 2, 1)
    assert missions.goal_position[0, 1].tolist() == [1.0, 2.0]
    assert missions.via_count[0, 1] == 1
    assert missions.via_position[0, 1].tolist() == [[5.0, 6.0], [0.0, 0.0]]
    assert missions.via_lane[0, 1].tolist() == [3, -1]
    assert missions.route[0].tolist() == [-1, 2, -1]
