"""The agent mf-ac-v0: mf_ac, intersections-double_merges-two_ways-on_ramps, random_social_vehicles, seed 1, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "mf-ac-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M4",
    provenance="mf_ac, intersections-double_merges-two_ways-on_ramps, random_social_vehicles, seed 1, last checkpoint",
)
