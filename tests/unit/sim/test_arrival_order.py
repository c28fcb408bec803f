"""Tickets for junctions, on a crossing whose arms are 80 m long and end 10 m from its middle."""

import math

from smarts.types.agent_states import AgentStatus
from smarts.types.mission import AgentMission
from tests import maps
from tests.unit.sim.stage import Stage
from tests.worlds import Car

WEST, SOUTH, EAST = (
    AgentMission(route=("west_in", "east_out")),
    AgentMission(route=("south_in", "north_out")),
    AgentMission(route=("east_in", "south_out")),
)


def stage_of(*distances, missions=(WEST, SOUTH, EAST)):
    """Return a stage with an agent on each arm, that far from the junction [m]."""
    stage = Stage(
        [Car(*place(agent_id, far), mission=missions[agent_id]) for agent_id, far in enumerate(distances)],
        graph=maps.crossing(),
    )
    stage.judge.reset(stage.contacts, stage.rows)
    return stage


def place(agent_id, far):
    far += 10.0
    return [(-far, -1.6, 0.0), (1.6, -far, math.pi / 2), (far, 1.6, math.pi)][agent_id]


def arrival_order(stage, *distances):
    stage.step(*(place(agent_id, far) for agent_id, far in enumerate(distances)))
    return stage.agents.arrival_number[0, : len(distances)].tolist()


def test_in_the_order_of_arrival():
    stage = stage_of(60.0, 50.0, 45.0)
    assert stage.agents.arrival_number[0].tolist() == [-1, -1, -1, -1]
    assert arrival_order(stage, 50.0, 41.0, 39.0) == [-1, -1, 0]
    assert arrival_order(stage, 41.0, 39.0, 35.0) == [-1, 1, 0]
    # Once drawn, a ticket holds, whoever is nearer now.
    assert arrival_order(stage, 10.0, 35.0, 35.0) == [2, 1, 0]
    assert stage.agents.arrival_junction[0].tolist() == [0, 0, 0, -1]


def test_in_the_same_step_the_nearer_then_the_lower_agent():
    assert arrival_order(stage_of(60.0, 60.0, 60.0), 39.5, 39.0, 39.5) == [1, 0, 2]


def test_until_it_is_through():
    stage = stage_of(30.0, 35.0, 60.0)
    assert stage.agents.arrival_number[0, :2].tolist() == [0, 1]
    # Inside the junction, and behind it, where the next one comes behind.
    assert arrival_order(stage, -10.0, 30.0, 60.0) == [0, 1, -1]
    assert arrival_order(stage, -21.0, 30.0, 39.0) == [-1, 1, 2]
    assert stage.agents.arrival_junction[0, 0] == -1


def test_who_is_done_gives_it_back_in_the_next_step():
    stage = stage_of(30.0, 35.0, 60.0)
    stage.step(*(place(agent_id, far) for agent_id, far in enumerate((30.0, 35.0, 60.0))), hits=[(0, 1)])
    assert stage.agents.state[0, 0] == AgentStatus.DONE
    assert stage.agents.arrival_number[0, :2].tolist() == [0, 1]
    stage.agents.state[0, 0], stage.agents.slot[0, 0] = AgentStatus.VACANT, -1
    stage.step()
    assert stage.agents.arrival_number[0, :2].tolist() == [-1, 1]


def test_off_its_route_an_agent_keeps_it():
    stage = stage_of(30.0, missions=(AgentMission(route=("west_in", "south_out")),))
    assert arrival_order(stage, -21.0) == [0]
