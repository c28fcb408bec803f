"""Drivers of version 1's tasks: their kinds differ where a vehicle cuts across, and agents meet them."""

import numpy as np
import pytest

from scenarios.drivers import ALL_KINDS, KINDS
from smarts.agents.benchmark import benchmark_interface
from smarts.sim.assembly import assemble
from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import UNSET
from smarts.types.vehicles import Owner

FULL = "random_social_vehicles"


def test_kinds_are_mixed():
    assert {*ALL_KINDS} == {actor for kind in KINDS.values() for actor in kind}
    assert sum(ALL_KINDS.values()) == pytest.approx(1.0)


@pytest.fixture(scope="module")
def starts():
    """Per episode: of each agent and of each social vehicle the way and x of front and rear [m]."""
    built = build_scenario("two_way_v1").with_traffic([FULL])
    parts = assemble([built], [benchmark_interface() for _ in range(4)], seed=3)
    found = []
    for episode in range(4):
        parts.simulation.reset({0: parts.schedule.start(0, episode)})
        world = parts.simulation.world
        states = world.vehicles.of(0)
        slots = world.agents.slot[0]
        assert (slots != UNSET).all()
        forward = np.cos(states.heading)
        middle = states.position[:, 0] * forward

        def place(slot, middle=middle, forward=forward, states=states):
            half = states.length[slot] / 2
            return round(float(forward[slot])), middle[slot] - half, middle[slot] + half

        social = np.flatnonzero(states.alive & (states.owner == Owner.TRAFFIC))
        speeds = dict(zip(map(place, social), states.speed[social].tolist(), strict=True))
        found.append(([place(slot) for slot in slots], speeds))
    parts.simulation.close()
    return found


class TestTwoWay:
    def test_each_front_agent_has_a_slow_leader(self, starts):
        for agents, social in starts:
            for way, _, front in agents[2:]:
                gap, speed = min(
                    (rear - front, speed)
                    for (other, rear, _), speed in social.items()
                    if other == way and rear > front
                )
                # 16 m, minus or plus the variation of starts and what the leader has driven.
                assert 10.0 <= gap <= 23.0
                assert speed <= 7.5

    def test_a_slow_vehicle_is_between_the_agents_of_a_lane(self, starts):
        for agents, social in starts:
            for (way, _, front), (_, rear, _) in zip(agents[:2], agents[2:], strict=True):
                between = [
                    speed
                    for (other, begin, end), speed in social.items()
                    if other == way and front < begin and end < rear
                ]
                assert len(between) == 1
                assert between[0] <= 7.5

    def test_both_ways_have_oncoming_traffic(self, starts):
        for _, social in starts:
            ways = [way for way, _, _ in social]
            assert min(ways.count(1), ways.count(-1)) >= 3
