"""Whole simulations: rows that are not stepped stay as they are, failures stay with their row."""

import numpy as np
import pytest

from smarts.agents import AgentInterface, DoneCriteria
from smarts.agents.options import Waypoints
from smarts.sim.assembly import assemble
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Outcome
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner

EGOS = 2


@pytest.fixture(scope="module")
def scenarios():
    return [build_scenario(name) for name in ("intersection", "double_merge", "roundabout", "loop")]


def interface(model="kinematic", **changes):
    return AgentInterface(
        max_episode_steps=80,
        waypoint_paths=Waypoints(lookahead=20),
        neighborhood_vehicle_states=True,
        action=ActionSpaceType.Lane,
        vehicle_model=model,
        done_criteria=DoneCriteria(**changes),
    )


@pytest.fixture
def three(scenarios):
    parts = assemble(scenarios[:1], [interface()] * EGOS, worlds=3)
    parts.simulation.reset({row: parts.schedule.start(row, 0) for row in range(3)})
    yield parts
    parts.simulation.close()


def stepped(parts, rows):
    mask = np.isin(np.arange(3), rows)
    return parts.simulation.step(parts.actions, mask, np.ones((3, EGOS), np.bool_))


def test_a_row_that_is_not_stepped_stays_as_it_is(three):
    world, starts = three.simulation.world, (three.schedule.start(1, episode) for episode in range(30))
    three.simulation.reset({1: next(start for start in starts if start.traffic.warm_up)})

    def state():
        tables = world.vehicles, world.before, world.agents, world.missions, world.guidance
        return [column[1].tobytes() for table in tables for column in table]

    stepped(three, [0, 1, 2])
    assert (world.vehicles.owner[1] == Owner.TRAFFIC).any()
    before, others = state(), world.vehicles.position[[0, 2]].copy()
    for _ in range(20):
        stepped(three, [0, 2])
    assert state() == before
    assert (world.vehicles.position[[0, 2]] != others).any(axis=(1, 2)).all()
    assert world.step.tolist() == [21, 1, 21]


def test_a_vehicle_that_fails_ends_its_own_episode_only(three):
    """In the middle of a step that the others make in full, with traffic."""
    vehicles, world = three.simulation._stages.vehicles, three.simulation.world
    assert not stepped(three, [0, 1, 2]).failures
    agents = world.agents.slot.shape[1]
    vehicles.fleet._bodies[agents : 2 * agents, 7] = np.nan
    frame = stepped(three, [0, 1, 2])
    assert [*frame.failures] == [1]
    assert "no longer finite" in str(frame.failures[1])
    assert frame.env_mask.tolist() == [True, False, True]
    assert frame.events.finished.tolist() == [False, True, False]
    assert (world.agents.outcome[1] == Outcome.INVALID).all()
    assert (world.agents.state[[0, 2]] == AgentStatus.ACTIVE).all()
    three.simulation.reset({1: three.schedule.start(1, 1)})
    for _ in range(3):
        assert not stepped(three, [0, 1, 2]).failures
    assert np.isfinite(world.vehicles.position).all()


def test_traffic_is_told_of_egos_before_the_first_step(three):
    """Their shadows are on the net when the episode begins, so that drivers mind them at once."""
    world = three.simulation.world
    for row in range(3):
        start = three.schedule.start(row, 0)
        engine = three.simulation._stages.traffic._simulations[row]
        for slot in np.flatnonzero(world.vehicles.owner[row] == Owner.AGENT).tolist():
            if start.traffic.warm_up:
                assert engine.can_accept(slot) != Refusal.OFF_LANES
                agent_id = int(np.flatnonzero(world.agents.slot[row] == slot)[0])
                assert engine._shadows._shadows[slot].route == start.agents[agent_id].mission.route
    assert any(three.schedule.start(row, 0).traffic.warm_up for row in range(3))
