"""The agent commnet-v0: commnet, intersections-double_merges-two_ways-on_ramps, random_social_vehicles, seed 1, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "commnet-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M3",
    provenance="commnet, intersections-double_merges-two_ways-on_ramps, random_social_vehicles, seed 1, last checkpoint",
)
