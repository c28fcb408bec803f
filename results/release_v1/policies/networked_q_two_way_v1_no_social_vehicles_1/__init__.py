"""The agent networked-q-two-way-v1-no-social-vehicles-1-v0: networked_q, two_way_v1, no_social_vehicles, seed 1, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "networked-q-two-way-v1-no-social-vehicles-1-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M3",
    provenance="networked_q, two_way_v1, no_social_vehicles, seed 1, last checkpoint",
)
