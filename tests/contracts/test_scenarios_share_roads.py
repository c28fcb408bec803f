"""SUMO's traffic copes with erratic egos and hand-overs in every scenario."""

import math

import numpy as np
import pytest

from smarts.providers.sumo_traffic import SumoTraffic
from smarts.sstudio.build import build_scenario, suite
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World

REST = [name for name in suite() if name != "intersection"]
EGOS = 4
STEPS = 600


class Wanderers:
    """Agents that drive at constant speed, turn slightly at random, and sometimes jump to a random lane."""

    def __init__(self, states, roads, rng):
        self.states, self.roads, self.rng = states, roads, rng
        self.lanes = np.flatnonzero(~roads.is_internal)

    def start(self, slot):
        lane = int(self.rng.choice(self.lanes))
        s = self.rng.uniform(0, self.roads.length[lane])
        x, y, heading = self.roads.pose_at(lane, s, self.rng.uniform(-2, 2))
        self.states.position[slot] = x, y
        self.states.heading[slot] = heading
        self.states.speed[slot] = self.rng.uniform(0, 15)

    def move(self):
        states = self.states
        for slot in np.flatnonzero(states.owner == Owner.AGENT):
            if self.rng.random() < 0.01:
                self.start(slot)
            heading = states.heading[slot] + self.rng.normal(0, 0.02)
            states.heading[slot] = heading
            states.position[slot] += (
                0.1 * states.speed[slot] * np.array([math.cos(heading), math.sin(heading)])
            )


@pytest.mark.parametrize(
    "name", ["intersection", *(pytest.param(name, marks=pytest.mark.nightly) for name in REST)]
)
def test_erratic_agents_and_hand_overs(name):
    built = build_scenario(name)
    roads = built.roads()
    world = World(worlds=1, capacity=1024, agents=0, lanes=len(roads.lane_ids))
    states = world.vehicles.of(0)
    rng = np.random.Generator(np.random.Philox(101))
    wanderers = Wanderers(states, roads, rng)
    for slot in range(EGOS):
        kind, length, width = (VehicleKind.PASSENGER, 4.5, 1.8) if slot else (VehicleKind.BUS, 12.0, 2.5)
        world.registry.admit(0, "ego", Owner.AGENT, kind, length, width)
        wanderers.start(slot)
    traffic = SumoTraffic(world, 0)
    traffic.reset(built.traffic["random_social_vehicles"], 1, roads)
    for step in range(STEPS):
        world.step += 1
        wanderers.move()
        for slot in np.flatnonzero(states.alive)[EGOS:]:
            if rng.random() < 0.01:
                states.owner[slot] = Owner.AGENT if states.owner[slot] == Owner.TRAFFIC else Owner.TRAFFIC
        agents = np.flatnonzero(states.owner == Owner.AGENT)
        before = states.position[agents].copy(), states.heading[agents].copy(), states.speed[agents].copy()
        traffic.step()
        after = states.position[agents], states.heading[agents], states.speed[agents]
        assert all((a == b).all() for a, b in zip(before, after, strict=True)), f"step {step} moved an agent"
        assert states.alive[agents].all(), f"step {step} removed an agent"
        moving = states.alive & (states.owner == Owner.TRAFFIC)
        assert np.isfinite(states.position[moving]).all()
        assert (states.speed[moving] >= 0).all()
    traffic.close()
