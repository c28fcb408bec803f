"""Agents that come and go: how many of an interface a simulation has room for."""

from __future__ import annotations

from collections.abc import Sequence

from smarts.agents.checks import Count, checked
from smarts.agents.interface import AgentInterface


@checked
class PooledAgents:
    """Room for agents of one interface beside the egos: social agents, and agents that take vehicles over."""

    interface: AgentInterface
    capacity: Count
    """The most agents of the interface that a simulation has at a time."""


def merge_pools(pool: Sequence[PooledAgents]) -> tuple[PooledAgents, ...]:
    """Return one entry per distinct interface, in order of appearance; capacities of equal ones are added."""
    merged: list[PooledAgents] = []
    for entry in pool:
        # By comparison: an interface with options of the user's own need not be hashable.
        place = next((n for n, each in enumerate(merged) if each.interface == entry.interface), len(merged))
        before = merged.pop(place).capacity if place < len(merged) else 0
        merged.insert(place, PooledAgents(entry.interface, before + entry.capacity))
    return tuple(merged)
