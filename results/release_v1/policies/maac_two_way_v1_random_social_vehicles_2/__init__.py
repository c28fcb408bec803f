"""The agent maac-two-way-v1-random-social-vehicles-2-v0: maac, two_way_v1, random_social_vehicles, seed 2, last checkpoint; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "maac-two-way-v1-random-social-vehicles-2-v0",
    partial(exported_spec, Path(__file__).parent),
    m_level="M3",
    provenance="maac, two_way_v1, random_social_vehicles, seed 2, last checkpoint",
)
