"""The scenario language and its build.

from smarts.sstudio import gen_scenario, types as t
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from smarts.sstudio.build import build_scenario, suite
    from smarts.sstudio.genscenario import (
        gen_agent_missions,
        gen_bubbles,
        gen_friction_map,
        gen_group_laps,
        gen_metadata,
        gen_missions,
        gen_scenario,
        gen_social_agent_missions,
        gen_traffic,
        gen_traffic_histories,
    )

_HOMES = {
    "build_scenario": "smarts.sstudio.build",
    "suite": "smarts.sstudio.build",
    "gen_agent_missions": "smarts.sstudio.genscenario",
    "gen_bubbles": "smarts.sstudio.genscenario",
    "gen_friction_map": "smarts.sstudio.genscenario",
    "gen_group_laps": "smarts.sstudio.genscenario",
    "gen_metadata": "smarts.sstudio.genscenario",
    "gen_missions": "smarts.sstudio.genscenario",
    "gen_scenario": "smarts.sstudio.genscenario",
    "gen_social_agent_missions": "smarts.sstudio.genscenario",
    "gen_traffic": "smarts.sstudio.genscenario",
    "gen_traffic_histories": "smarts.sstudio.genscenario",
}

__all__ = [
    "build_scenario",
    "gen_agent_missions",
    "gen_bubbles",
    "gen_friction_map",
    "gen_group_laps",
    "gen_metadata",
    "gen_missions",
    "gen_scenario",
    "gen_social_agent_missions",
    "gen_traffic",
    "gen_traffic_histories",
    "suite",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for only then, so that the vocabulary alone loads fast."""
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
