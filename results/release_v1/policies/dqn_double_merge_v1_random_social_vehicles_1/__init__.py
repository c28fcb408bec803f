"""The agent dqn-double-merge-v1-random-social-vehicles-1-v0: dqn, double_merge_v1, random_social_vehicles, seed 1, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "dqn-double-merge-v1-random-social-vehicles-1-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M1",
    provenance="dqn, double_merge_v1, random_social_vehicles, seed 1, last checkpoint",
)
