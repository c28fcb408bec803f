"""The agent dqn-v0: dqn, intersections-double_merges-two_ways-on_ramps, random_social_vehicles, seed 1, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "dqn-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M1",
    provenance="dqn, intersections-double_merges-two_ways-on_ramps, random_social_vehicles, seed 1, last checkpoint",
)
