"""Agent specs: an interface, how to make the policy, and adapters between the two."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.policy import Agent

ADAPTERS = ("observation", "action", "reward", "info")
"""What the adapters of a spec change."""


def _unchanged(*values: Any) -> Any:
    """Return the last value, which an adapter is to change: observation, action, reward or info."""
    return values[-1]


@dataclass
class AgentSpec:
    """What an environment has to know of an agent; names and defaults of the fields are the original's.

    `policy_builder` and `policy_params` are the paper's names of `agent_builder` and `agent_params`;
    whichever is given, both hold it.

    Raises:
        InterfaceError: Old and new name of a field are given, and differ.
    """

    interface: AgentInterface | None = None
    """May be filled in later, by `replace`."""
    agent_builder: Callable[..., Agent] | None = None
    """Makes the policy from `agent_params`."""
    agent_params: Any = None
    """A mapping is given as keywords, a list or tuple in its order, anything else as the one argument."""
    policy_builder: Callable[..., Agent] | None = None
    policy_params: Any = None
    observation_adapter: Callable[[Any], Any] = _unchanged
    """Observation -> what the policy sees."""
    action_adapter: Callable[[Any], Any] = _unchanged
    """What the policy says -> action."""
    reward_adapter: Callable[[Any, float], Any] = _unchanged
    """Observation, reward -> reward."""
    info_adapter: Callable[[Any, float, Any], Any] = _unchanged
    """Observation, reward, info -> info."""
    perform_self_test: bool = False
    """Has no effect. Kept so that the original's specs can be read."""
    observation_space: Any = None
    """Space of what `observation_adapter` returns; environments that declare spaces need it (not in the
    original)."""
    action_space: Any = None
    """Space of what `action_adapter` takes; None: that of the agent's interface (not in the original)."""

    def __post_init__(self) -> None:
        for name in ("builder", "params"):
            new, old = getattr(self, f"agent_{name}"), getattr(self, f"policy_{name}")
            given = old if new is None else new
            setattr(self, f"agent_{name}", given)
            setattr(self, f"policy_{name}", given)

    @property
    def own_adapters(self) -> frozenset[str]:
        """Names of the adapters that do something: "observation", "action", "reward", "info"."""
        return frozenset(name for name in ADAPTERS if getattr(self, f"{name}_adapter") is not _unchanged)

    def replace(self, **changes: Any) -> AgentSpec:
        """Return a copy with some fields changed, under their old names or their new ones."""
        for name in ("builder", "params"):
            new, old = f"agent_{name}", f"policy_{name}"
            if (new in changes) != (old in changes):
                changes[new] = changes[old] = changes.get(new, changes.get(old))
        return replace(self, **changes)

    def build_agent(self) -> Agent:
        """Make the policy.

        Raises:
            InterfaceError: The spec does not say how, or not by something that can be called.
        """
        builder, given = self.agent_builder, self.agent_params
        if not callable(builder):
            raise InterfaceError(
                f"the agent cannot be built by {builder!r}",
                place="AgentSpec.agent_builder",
                remedy="give a class or function, and what it takes as agent_params",
            )
        if given is None:
            return builder()
        if isinstance(given, Mapping):
            return builder(**given)
        return builder(*given) if isinstance(given, list | tuple) else builder(given)
