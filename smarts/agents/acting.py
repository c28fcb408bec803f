"""Acting in two phases: agents get their observations, and the simulation fetches their actions when due.

In between, the simulation (or the learner) does other work, so that agents in other processes or on other
hosts think meanwhile; those in this process think when their actions are fetched.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol


class ActionRequest(NamedTuple):
    """Identifies one decision of one agent.

    The answer to a request that is no longer open is dropped: since episodes, agents and vehicles follow each
    other, it could else be taken for the answer to a later one.
    """

    row: int
    """The simulation."""
    episode: int
    agent_id: int
    generation: int
    """Of the vehicle; with its slot, it identifies the vehicle."""
    step: int
    """Of the episode, when the request was made."""


class AgentHost(Protocol):
    """Runs the agents that are not the environment's user's."""

    def dispatch(self, observations: Mapping[ActionRequest, Any]) -> None:
        """Send agents their observations, without waiting."""
        ...

    def gather(self, deadline: float) -> Mapping[ActionRequest, Any]:
        """Return the actions that have come, at the latest after `deadline` [s].

        Late agents keep the lasting part of their last action.
        """
        ...

    def close(self) -> None:
        """End the agents; may be called again."""
        ...


class InProcess:
    """Runs agents in this process: they decide when their actions are fetched, however long they take.

    Args:
        build: Makes the agent of an agent_id, with a method `act(observation)`; called again for each vehicle
            that the agent gets.
    """

    def __init__(self, build: Callable[[int], Any]) -> None:
        self._build = build
        self._agents: dict[tuple[int, int], tuple[tuple[int, int], Any]] = {}
        self._asked: dict[ActionRequest, Any] = {}

    def dispatch(self, observations: Mapping[ActionRequest, Any]) -> None:
        """Keep the observations."""
        self._asked.update(observations)

    def gather(self, deadline: float) -> Mapping[ActionRequest, Any]:
        """Let every agent decide that has a request; there is no deadline, so that runs can be repeated."""
        asked, self._asked = self._asked, {}
        return {request: self._agent(request).act(seen) for request, seen in asked.items()}

    def close(self) -> None:
        """Forget the agents."""
        self._agents.clear()
        self._asked.clear()

    def _agent(self, request: ActionRequest) -> Any:
        """Return the agent of a request; it lives as long as it has the same vehicle."""
        place, lifetime = (request.row, request.agent_id), (request.episode, request.generation)
        if place not in self._agents or self._agents[place][0] != lifetime:
            self._agents[place] = (lifetime, self._build(request.agent_id))
        return self._agents[place][1]
