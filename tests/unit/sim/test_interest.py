"""Agents that end when the vehicles of interest to them are gone."""

from contextlib import closing

import numpy as np
import pytest

from smarts.agents import AgentInterface, DoneCriteria, InterestDoneCriteria
from smarts.sim.assembly import assemble
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described
from smarts.types.actions import ActionSpaceType
from smarts.types.events import Outcome

NODES = """<nodes>
    <node id="a" x="0" y="0"/> <node id="b" x="60" y="0"/> <node id="c" x="0" y="100"/>
    <node id="d" x="120" y="100"/> <node id="e" x="0" y="200"/> <node id="f" x="900" y="200"/>
</nodes>"""
EDGES = """<edges>
    <edge id="short" from="a" to="b" speed="10"/> <edge id="long" from="c" to="d" speed="10"/>
    <edge id="ego" from="e" to="f" speed="10"/>
</edges>"""


def left_when_it_ends(folder, criteria):
    """Return the other vehicles in the step in which the ego ends, None if it drives for 40 s.

    The scenario marks `leader`, which leaves the map before `other` does.
    """
    (folder / "map.nod.xml").write_text(NODES)
    (folder / "map.edg.xml").write_text(EDGES)
    ways = {"leader": "short", "other": "long"}
    trips = [t.Trip(name, t.Route((edge, 0, 10), (edge, 0, "max"))) for name, edge in ways.items()]
    scenario = t.Scenario(
        traffic={"cars": t.Traffic(flows=[], trips=trips)},
        ego_missions=[t.Mission(t.Route(("ego", 0, 10), ("ego", 0, 890)))],
        scenario_metadata=t.ScenarioMetadata({}, actor_of_interest_re_filter="lead"),
    )
    done = DoneCriteria(interest=InterestDoneCriteria(**criteria))
    ego = AgentInterface(action=ActionSpaceType.Lane, vehicle_model="kinematic", done_criteria=done)
    parts = assemble([build_described(folder, scenario)], [ego])
    starts = (parts.schedule.start(0, episode) for episode in range(2))
    world, agents = parts.simulation.world, parts.simulation.world.agents
    with closing(parts.simulation):
        parts.simulation.reset({0: next(start for start in starts if start.traffic_name)})
        for _ in range(400):
            parts.simulation.step(parts.actions, np.ones(1, np.bool_), np.zeros((1, 1), np.bool_))
            if agents.outcome[0, 0] != Outcome.NONE:
                assert agents.outcome[0, 0] == Outcome.OTHER
                slots = np.flatnonzero(world.vehicles.alive[0]).tolist()
                return {world.registry.name(0, slot) for slot in slots} & {*ways}
    return None


@pytest.mark.parametrize(
    ("criteria", "left"),
    [
        ({}, {"other"}),
        ({"actors_filter": ["oth"]}, set()),
        ({"actors_filter": ["oth"], "include_scenario_marked": False}, set()),
        ({"actors_filter": ["ther"]}, {"other"}),  # no name begins so
        ({"include_scenario_marked": False}, None),
        ({"include_scenario_marked": False, "strict": True}, {"leader", "other"}),
    ],
)
def test_an_agent_ends_when_nobody_of_interest_is_left(tmp_path, criteria, left):
    assert left_when_it_ends(tmp_path, criteria) == left
