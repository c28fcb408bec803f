"""Asynchronous policies: `dispatch` sends observations, `gather` collects actions when they are due.

Agents in other processes compute in between; in-process agents compute in `gather`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol


class ActionRequest(NamedTuple):
    """Identifies one decision of one agent.

    The answer to a request that is no longer open is dropped: it could be taken for the answer to a later one
    of another episode or agent.
    """

    row: int
    """The simulation."""
    episode: int
    agent_id: int
    name: str
    """Of the agent."""
    hold: int
    """The agent's number among all that have held a column of the simulation, in all of its episodes."""
    step: int
    """Of the episode, when the request was made."""


class AgentHost(Protocol):
    """Runs the social agents."""

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
        build: Makes an agent, with a method `act(observation)`, given its first request; called once for each
            agent that enters.
    """

    def __init__(self, build: Callable[[ActionRequest], Any]) -> None:
        self._build = build
        self._agents: dict[tuple[int, int], tuple[int, Any]] = {}
        self._asked: dict[ActionRequest, Any] = {}

    def dispatch(self, observations: Mapping[ActionRequest, Any]) -> None:
        """Keep the observations."""
        self._asked.update(observations)

    def gather(self, deadline: float) -> Mapping[ActionRequest, Any]:
        """Return the actions of all requests; the deadline is ignored, so that runs can be repeated."""
        asked, self._asked = self._asked, {}
        return {request: self._agent(request).act(seen) for request, seen in asked.items()}

    def close(self) -> None:
        """Forget the agents."""
        self._agents.clear()
        self._asked.clear()

    def _agent(self, request: ActionRequest) -> Any:
        """Return the agent of a request; it lives as long as it holds its column."""
        place = request.row, request.agent_id
        if place not in self._agents or self._agents[place][0] != request.hold:
            self._agents[place] = request.hold, self._build(request)
        return self._agents[place][1]
