"""The zoo: policies of road users by name, imported only when one is asked for; docs/guide/zoo.md."""

from smarts.agents.spec import AgentSpec
from smarts.zoo.registry import (
    build_agent,
    entries,
    find_entry,
    make,
    make_agent,
    make_spec,
    register,
    search,
)

__all__ = [
    "AgentSpec",
    "build_agent",
    "entries",
    "find_entry",
    "make",
    "make_agent",
    "make_spec",
    "register",
    "search",
]
