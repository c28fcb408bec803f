"""Social policies: the policies of the agents that are no egos, by their number in a run."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.agents.spec import AgentSpec


@dataclass(frozen=True)
class SocialPolicy:
    """One policy of a run, which acts for any number of agents; its number is its place in the run's list."""

    name: str
    """For errors and records: that of its actor in the scenario, or its locator."""
    locator: str
    """Its name in the zoo, as "module:name-v0"."""
    spec: AgentSpec
    """Its interface, and how it is made."""
    interface: int
    """Number of its interface in the pool."""
    period: int = 1
    """Steps from one decision to the next."""
    is_boid: bool = False
    """Whether one instance acts for all vehicles of a bubble."""
