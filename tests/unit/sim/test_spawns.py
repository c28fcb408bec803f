"""Entering traffic does no harm: nobody runs into an agent in its first seconds if that keeps its lane.

An agent that keeps its lane minds the vehicle ahead, but nobody's right of way. What happens from the stop
line of a junction on therefore is its own doing, and not counted.
"""

from contextlib import closing

import numpy as np
import pytest

from smarts.agents import ActionSpaceType, AgentInterface, DoneCriteria
from smarts.sim.assembly import assemble
from smarts.sstudio.build import build_scenario, suite
from smarts.sstudio.episodes import expand
from smarts.types.events import Event, Outcome

SEEDS, STEPS = 5, 50


def is_before_junctions(world, roads, agent_id):
    """Tell whether all of an agent's vehicle is on a road."""
    vehicles, slot = world.vehicles, int(world.agents.slot[0, agent_id])
    lane = int(vehicles.lane[0, slot])
    front = vehicles.lane_position[0, slot] + vehicles.length[0, slot] / 2
    return lane < 0 or not (roads.is_internal[lane] or front > roads.length[lane])


def entries(name, seeds):
    """Yield for each seed whether the start amid traffic was void, and the agents' collisions on roads."""
    interface = AgentInterface(action=ActionSpaceType.Lane, done_criteria=DoneCriteria(off_route=False))
    built = build_scenario(name)
    egos = min(4, len(expand(built.scenario.ego_missions or ())) or 1)
    parts = assemble([built], [interface] * egos)
    simulation, world, roads = parts.simulation, parts.simulation.world, built.roads()
    rows, nobody = np.ones(1, np.bool_), np.zeros((1, egos), np.bool_)
    with closing(simulation):
        for seed in range(seeds):
            starts = (parts.schedule.start(0, episode, seed) for episode in range(50))
            start = next(start for start in starts if start.traffic.warm_up)
            frame = simulation.reset({0: start})
            void = bool((world.agents.outcome[0] == Outcome.INVALID).any())
            hit = []
            for step in range(0 if void else STEPS):
                frame = simulation.step(parts.actions, rows, nobody)
                for agent_id in np.flatnonzero(frame.events.bits[0] & Event.COLLISION).tolist():
                    if not is_before_junctions(world, roads, agent_id):
                        continue
                    side = int(frame.contacts.side[0, agent_id])
                    partner = int(frame.contacts.partner[0, agent_id])
                    hit.append((step, agent_id, side, parts.scene.world.registry.name(0, partner)))
                if frame.events.finished[0]:
                    break
            yield seed, void, hit


@pytest.mark.parametrize(
    "name",
    [name if name == "intersection" else pytest.param(name, marks=pytest.mark.nightly) for name in suite()],
)
def test_nobody_is_hit_in_the_first_five_seconds(name):
    told = list(entries(name, SEEDS))
    assert [seed for seed, void, _ in told if void] == []
    assert {seed: hit for seed, _, hit in told if hit} == {}
