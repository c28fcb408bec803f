"""Bubbles of the scenario language on their map."""

import sys

import numpy as np
import pytest
from shapely.geometry import Polygon

from smarts.bubbles.placing import Driver, agent_actor, columns_needed, place_bubbles
from smarts.sstudio import sstypes as t
from smarts.sstudio.sstypes.actor.traffic_engine_actor import SUMO_TRAFFIC
from smarts.types.bubbles import UNLIMITED
from tests import maps

AGENT = t.SocialAgentActor("agent", "zoo:agent-v0")
ZONE = t.PositionalZone((100, 0), (20, 10))
ROADS = maps.straight()


DRIVER = Driver(2, 1, 5)


def place(*bubbles, driver=DRIVER):
    return place_bubbles(bubbles, ROADS, lambda bubble: driver)


def area(rings):
    return Polygon(rings[0], rings[1:])


def test_a_bubble_on_its_map():
    (made,) = place(
        t.Bubble(
            ZONE, AGENT, margin=5, exclusion_prefixes=["bus"], id="b", collision_time=2, keep_alive=False
        )
    )
    assert (made.id, made.actor, made.policy, made.interface, made.period) == ("b", "agent", 2, 1, 5)
    assert area(made.zone).bounds == (90, -5, 110, 5)
    assert area(made.margin).equals(Polygon([(85, -10), (115, -10), (115, 10), (85, 10)])), "mitred corners"
    assert (made.spared, made.collision_time, made.centroid) == (("bus",), 2.0, (100.0, 0.0))
    assert (made.active_condition, made.airlock_condition, made.followed) == (None, None, "")
    assert np.array_equal(made.zone[0][0], made.zone[0][-1]), "rings are closed"


def test_zones_along_lanes():
    (made,) = place(t.Bubble(t.MapZone(("road", 0, 50), 30, 2), AGENT, margin=0))
    left, low, right, high = area(made.zone).bounds
    assert (left, right) == pytest.approx((50, 80))
    assert 6.4 < high - low < 7.2
    assert area(made.margin).equals(area(made.zone))


def test_random_zones_are_the_same_in_every_run():
    bubble = t.Bubble(t.MapZone(("road", 0, "random"), 30, 1), AGENT)
    first, second = place(bubble), place(bubble)
    assert np.array_equal(first[0].zone[0], second[0].zone[0])


@pytest.mark.parametrize(
    ("limit", "capacity", "expected", "columns"),
    [
        (None, None, (UNLIMITED, UNLIMITED), 32),
        (t.BubbleLimits(2, 5), None, (2, 5), 5),
        (t.BubbleLimits(2, sys.maxsize), None, (2, UNLIMITED), 32),
        (t.BubbleLimits(4, 9), t.BubbleLimits(3, 10), (3, 9), 9),
        (None, t.BubbleLimits(3, 5), (3, 5), 5),
    ],
)
def test_limits_are_those_of_the_bubble_and_of_the_boid(limit, capacity, expected, columns):
    actor = AGENT if capacity is None else t.BoidAgentActor("boid", "zoo:boid-v0", capacity=capacity)
    bubble = t.Bubble(ZONE, actor, limit=limit)
    (made,) = place(bubble)
    assert (made.hijack_limit, made.shadow_limit) == expected
    assert columns_needed(bubble) == columns


def test_traffic_engines_are_served_by_the_zoo_or_left_with_sumo():
    local = t.TrafficEngineActor(
        "local",
        tau=1.5,
        accel=2.0,
        decel=3.0,
        max_speed=30.0,
        min_gap=t.UniformDistribution(1.0, 3.0),
        speed=t.TruncatedDistribution(-1, 1, 0.8, 0.1),
    )
    actor = agent_actor(t.Bubble(ZONE, local))
    assert actor is not None
    assert (actor.name, actor.agent_locator) == ("local", "smarts.zoo:idm-v0")
    assert actor.policy_kwargs == pytest.approx(
        {"tau": 1.5, "accel": 2.0, "decel": 3.0, "max_speed": 30.0, "min_gap": 2.0, "speed_factor": 0.8}
    )
    sumo = t.Bubble(ZONE, t.TrafficEngineActor("sumo", traffic_provider=SUMO_TRAFFIC))
    assert agent_actor(sumo) is None
    assert [made.actor for made in place(sumo, t.Bubble(ZONE, AGENT), t.Bubble(ZONE, local))] == [
        "agent",
        "local",
    ]


def test_means_of_distributions_are_those_of_many_samples():
    generator = np.random.default_rng(1)
    for distribution in (
        t.UniformDistribution(3, 1),
        t.TruncatedDistribution(-1, 2, 5.0, 2.0),
        t.TruncatedDistribution(0.5, 9, -1.0, 0.3),
        t.Distribution(2.0, 0.1),
    ):
        samples = [distribution.sample(generator) for _ in range(20_000)]
        assert distribution.mean == pytest.approx(np.mean(samples), abs=0.03)
    assert t.TruncatedDistribution(60, 61).mean == 60.0
