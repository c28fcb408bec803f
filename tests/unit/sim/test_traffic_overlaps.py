"""Pairs of vehicles of traffic that overlap are counted once each, and agents' vehicles are none of them."""

import numpy as np
import pytest

from smarts.geometry.binding import bind
from smarts.sim.traffic_overlaps import count_overlaps
from smarts.types.vehicles import Owner
from smarts.types.world import World


@pytest.fixture
def world():
    """Return a world of two simulations with cars of 4 x 2 m every 10 m along x, all of traffic."""
    world = World(worlds=2, capacity=4, agents=1, lanes=1)
    vehicles = world.vehicles
    vehicles.alive[:], vehicles.owner[:], vehicles.generation[:] = True, Owner.TRAFFIC, 1
    world.registry.used[:] = 4
    vehicles.length[:], vehicles.width[:] = 4.0, 2.0
    vehicles.position[..., 0] = 10.0 * np.arange(4)
    return world


def count(world, *rows):
    """Make a step: count, and let what is now be what was; return the counts so far."""
    bind(count_overlaps, world.state, world.traffic_overlaps)(np.isin([0, 1], rows or (0, 1)))
    world.advance(np.ones(2, np.bool_))
    return world.traffic_overlaps.tolist()


def test_a_pair_counts_when_it_begins_to_overlap(world):
    assert count(world) == [0, 0]
    world.vehicles.position[0, 1, 0] = 3.9  # 10 cm into the car at 0
    assert count(world) == [1, 0]
    world.vehicles.position[0, 1, 0] = 3.0
    assert count(world) == [1, 0]
    world.vehicles.position[0, 1, 0] = 5.0
    assert count(world) == [1, 0]
    world.vehicles.position[0, 1, 0] = 3.9
    assert count(world) == [2, 0]


@pytest.mark.parametrize(
    ("change", "pairs"),
    [
        ({}, 1),
        ({"position": (3.99, 0.0)}, 0),  # 1 cm is less than counts
        ({"position": (3.0, 2.1)}, 0),
        ({"position": (3.0, 2.1), "heading": np.pi / 4}, 1),  # its corner reaches 2.12 m
        ({"owner": Owner.AGENT}, 0),
        ({"alive": False}, 0),
        ({"height": 5.0}, 0),
        ({"height": 2.0}, 1),
    ],
)
def test_which_pairs_count(world, change, pairs):
    count(world)
    for name, value in ({"position": (3.0, 0.0)} | change).items():
        getattr(world.vehicles, name)[1, 1] = value
    assert count(world) == [0, pairs]
