"""The agent ppo-double-merge-v1-random-social-vehicles-4-v0: ppo, double_merge_v1, random_social_vehicles, seed 4, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "ppo-double-merge-v1-random-social-vehicles-4-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M1",
    provenance="ppo, double_merge_v1, random_social_vehicles, seed 4, last checkpoint",
)
