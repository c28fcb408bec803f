"""The observed traffic lights equal SUMO's signals on a map of the suite."""

from collections import Counter

import numpy as np
import pytest
import sumolib

from smarts.env import VectorHiWayEnv
from smarts.observations.lists import feature_list
from smarts.sstudio.build import build_scenario

LIGHT = feature_list("benchmark").layout(4)["light"].start
OBSERVED = {"r": -1.0, "y": -0.5, "u": -0.5, "o": -0.5, "O": -0.5, "s": -0.5, "g": 1.0, "G": 1.0}
OPENNESS = {0.0: 0, -1.0: 1, -0.5: 2, 1.0: 3}
"""Rank of each observed value; of several lights, the one with the highest rank is observed."""


@pytest.fixture
def city():
    env = VectorHiWayEnv(1, ["city"], agents=4, traffic=["random_social_vehicles"], seed=3)
    yield env
    env.close()


def light_at_the_end(connections, edge, state_of):
    """Return the light of the connections to an edge, or of all connections if none leads there."""
    onward = [each for each in connections if each.getTo().getID() == edge] or connections
    lights = {
        OBSERVED[state_of(each.getTLSID())[each.getTLLinkIndex()]] for each in onward if each.getTLSID() != ""
    }
    return max(lights | {0.0}, key=OPENNESS.__getitem__)


@pytest.mark.slow
def test_agents_observe_the_light_at_the_end_of_their_lane(city):
    net = sumolib.net.readNet(str(build_scenario("city").directory / "map.net.xml"))
    now, batch, observed = city.reset(), city._runner, Counter()
    world = batch.world
    state_of = batch.simulation._stages.traffic._simulations[0]._library.trafficlight.getRedYellowGreenState
    for _ in range(60):
        agents, graph = world.agents, batch.scene.atlas.graphs[int(world.map[0])]
        for agent in np.flatnonzero(now.alive[0] & agents.on_route[0]).tolist():
            lane = int(world.vehicles.lane[0, agents.slot[0, agent]])
            route = city.episodes[0].agents[agent].mission.route
            if lane < 0 or graph.is_internal[lane]:
                continue
            sumos = net.getLane(graph.lane_ids[lane])
            place = route.index(sumos.getEdge().getID())
            if place + 1 == len(route):
                continue  # its goal is on this road
            light = light_at_the_end(sumos.getOutgoing(), route[place + 1], state_of)
            (leaves,) = now.observations
            assert leaves[""][0, agent, LIGHT] == light, (graph.lane_ids[lane], route[place + 1])
            observed[light] += 1
        now = city.step([np.zeros((1, 4), np.int64)])
    assert min(observed[-1.0], observed[1.0], observed[0.0]) >= 5
