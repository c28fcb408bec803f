"""Agents of the zoo as road users."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from smarts.sstudio.sstypes.actor import Actor
from smarts.sstudio.sstypes.bubble_limits import BubbleLimits
from smarts.sstudio.sstypes.drawing import drawing


@dataclass(frozen=True, eq=False)
class SocialAgentActor(Actor):
    """A vehicle driven by an agent of the zoo."""

    agent_locator: str
    """The agent's registered name, as "module:name-v0"."""
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    """Arguments for the agent's policy, in place of the registered ones."""
    initial_speed: float | None = None
    """The speed at the start [m/s]; the default is a standing start."""


@dataclass(frozen=True, eq=False)
class BoidAgentActor(SocialAgentActor):
    """One agent that drives several vehicles."""

    id: str = field(default_factory=lambda: drawing().serial("boid"))
    capacity: BubbleLimits | None = None
    """Limit to the number of its vehicles."""
