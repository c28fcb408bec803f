"""The scenario language and its build.

from smarts.sstudio import gen_scenario, types as t
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from smarts.sstudio.genscenario import (
    gen_agent_missions,
    gen_bubbles,
    gen_family,
    gen_friction_map,
    gen_group_laps,
    gen_metadata,
    gen_missions,
    gen_scenario,
    gen_social_agent_missions,
    gen_traffic,
    gen_traffic_histories,
)

if TYPE_CHECKING:
    from smarts.sstudio.build import build_scenario, suite

__all__ = [
    "build_scenario",
    "gen_agent_missions",
    "gen_bubbles",
    "gen_family",
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
    """Import the build only when asked for, so that the vocabulary alone loads fast."""
    if name not in ("build_scenario", "suite"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from smarts.sstudio import build

    return getattr(build, name)
