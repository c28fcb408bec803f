"""Acting in two phases: agents are asked, and their answers are fetched when the simulation needs them.

Between the two the simulation (or the learner) does something else, so that agents in other processes or on
other hosts think meanwhile; those in this process think when their answers are fetched.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol


class ActionRequest(NamedTuple):
    """Names one decision of one agent for good.

    An answer to a question that is not open any more is dropped: since episodes, agents and vehicles follow
    each other, it could else be taken for the next one's.
    """

    row: int
    """The simulation."""
    episode: int
    agent_id: int
    generation: int
    """Of the vehicle, which with its slot names it."""
    step: int
    """Of the episode, when the agent was asked."""


class AgentHost(Protocol):
    """The agents that drive agents other than those of the environment's user."""

    def dispatch(self, observations: Mapping[ActionRequest, Any]) -> None:
        """Send agents what they see; return at once."""
        ...

    def gather(self, deadline: float) -> Mapping[ActionRequest, Any]:
        """Return the actions that are there, at the latest after `deadline` [s].

        Who has not answered by then keeps doing what lasts of its last action.
        """
        ...

    def close(self) -> None:
        """End the agents; may be called again."""
        ...


class InProcess:
    """Agents in this process: they decide when their answers are fetched, however long they take.

    Args:
        build: Makes an agent, with a method `act(observation)`; called again for each vehicle that the
            agent is given.
    """

    def __init__(self, build: Callable[[int], Any]) -> None:
        self._build = build
        self._agents: dict[tuple[int, int], tuple[tuple[int, int], Any]] = {}
        self._asked: dict[ActionRequest, Any] = {}

    def dispatch(self, observations: Mapping[ActionRequest, Any]) -> None:
        """Keep the observations."""
        self._asked.update(observations)

    def gather(self, deadline: float) -> Mapping[ActionRequest, Any]:
        """Let every agent that was asked decide; there is no deadline, so that runs can be repeated."""
        asked, self._asked = self._asked, {}
        return {question: self._agent(question).act(seen) for question, seen in asked.items()}

    def close(self) -> None:
        """Forget the agents."""
        self._agents.clear()
        self._asked.clear()

    def _agent(self, question: ActionRequest) -> Any:
        """Return who answers: an agent lives as long as its hold on the vehicle."""
        place, life = (question.row, question.agent_id), (question.episode, question.generation)
        if place not in self._agents or self._agents[place][0] != life:
            self._agents[place] = (life, self._build(question.agent_id))
        return self._agents[place][1]
