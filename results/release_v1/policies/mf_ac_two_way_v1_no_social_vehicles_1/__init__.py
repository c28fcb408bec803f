"""The agent mf-ac-two-way-v1-no-social-vehicles-1-v0: mf_ac, two_way_v1, no_social_vehicles, seed 1, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "mf-ac-two-way-v1-no-social-vehicles-1-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M4",
    provenance="mf_ac, two_way_v1, no_social_vehicles, seed 1, last checkpoint",
)
