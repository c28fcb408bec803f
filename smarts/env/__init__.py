"""Environments: the simulation as Gymnasium, PettingZoo, RLlib, PyMARL and arrays."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from smarts.env.black_death import BlackDeath
    from smarts.env.hiway import HiWayEnv
    from smarts.env.parallel import hiway_parallel_env
    from smarts.env.pymarl import PyMARLEnv
    from smarts.env.rllib import RLlibHiWayEnv
    from smarts.env.single import SingleHiWayEnv
    from smarts.env.single_vector import SingleHiWayVectorEnv
    from smarts.env.vector import VectorHiWayEnv

__all__ = [
    "BlackDeath",
    "HiWayEnv",
    "PyMARLEnv",
    "RLlibHiWayEnv",
    "SingleHiWayEnv",
    "SingleHiWayVectorEnv",
    "VectorHiWayEnv",
    "hiway_parallel_env",
]

# Imported on first use, since Ray is optional.
_PLACES = {
    "HiWayEnv": "smarts.env.hiway",
    "PyMARLEnv": "smarts.env.pymarl",
    "RLlibHiWayEnv": "smarts.env.rllib",
    "SingleHiWayEnv": "smarts.env.single",
    "SingleHiWayVectorEnv": "smarts.env.single_vector",
    "BlackDeath": "smarts.env.black_death",
    "VectorHiWayEnv": "smarts.env.vector",
    "hiway_parallel_env": "smarts.env.parallel",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_PLACES[name]), name)


# `gymnasium.make("smarts.env:hiway-v0")` imports this module to find the names. Gymnasium's checks are off,
# since they reject agents that come and go.
gymnasium.register(
    "hiway-v0", entry_point="smarts.env.hiway:HiWayEnv", disable_env_checker=True, order_enforce=False
)
gymnasium.register(
    "hiway-single-v0",
    entry_point="smarts.env.single:SingleHiWayEnv",
    vector_entry_point="smarts.env.single_vector:SingleHiWayVectorEnv",
)
