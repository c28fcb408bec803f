"""Policies: whatever turns an observation into an action."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Agent:
    """Acts on what it sees. Subclasses define `act`."""

    @classmethod
    def from_function(
        cls,
        agent_function: Callable[[Any], Any] | None = None,
        *,
        policy_function: Callable[[Any], Any] | None = None,
    ) -> Agent:
        """Return an agent that acts by a function of the observation; either argument's name will do.

        Raises:
            TypeError: There is no function, or it cannot be called.
        """
        function = agent_function if policy_function is None else policy_function
        if not callable(function):
            raise TypeError(f"from_function() needs a function of the observation, not {function!r}")
        return _FunctionAgent(function)

    def act(self, obs: Any) -> Any:
        """Return the action for an (adapted) observation."""
        raise NotImplementedError(f"{type(self).__name__} does not define act(obs)")


class _FunctionAgent(Agent):
    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function

    def act(self, obs: Any) -> Any:
        return self._function(obs)


class AgentPolicy(Agent):
    """The paper's name of `Agent`."""
