"""The agent maddpg-double-merge-v1-no-social-vehicles-5-v0: maddpg, double_merge_v1, no_social_vehicles, seed 5, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "maddpg-double-merge-v1-no-social-vehicles-5-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M3",
    provenance="maddpg, double_merge_v1, no_social_vehicles, seed 5, last checkpoint",
)
