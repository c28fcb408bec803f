"""The agent dqn-two-way-v1-no-social-vehicles-2-v0: dqn, two_way_v1, no_social_vehicles, seed 2, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "dqn-two-way-v1-no-social-vehicles-2-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M1",
    provenance="dqn, two_way_v1, no_social_vehicles, seed 2, last checkpoint",
)
