"""Agents elsewhere, as agents of this process: to describe them, to test them, and to drive egos."""

from __future__ import annotations

import time
from typing import Any

from numpy.typing import NDArray

from smarts.agents.hosting.facts import check_observation, check_period, interface_from
from smarts.agents.hosting.options import START_TIME, HostError, Link, Starter, about
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.agents.spec import AgentSpec
from smarts_agent_kit.service import checked_actions, one_line, request_of


class RemoteAgent(BatchAgent):
    """Asks an agent elsewhere, and waits for its answers.

    Args:
        start: Starts the agent.

    Raises:
        HostError: It does not start.
    """

    # Each has its own.
    interface: Any  # pyright: ignore[reportIncompatibleVariableOverride]
    observation: Any  # pyright: ignore[reportIncompatibleVariableOverride]
    period: Any  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, start: Starter) -> None:
        self.start = start
        self._link: Link | None = start.open()
        self._number = 0
        try:
            facts = about(self._link, start.place)
            self.interface = interface_from(facts.get("interface"), start.place)
            self.observation = check_observation(facts.get("observation"), start.place)
            self.period = check_period(facts.get("period"), start.place)
        except BaseException:
            self.close()
            raise

    def act(self, obs: ActionBatch) -> NDArray:
        """Return the agent's actions.

        Raises:
            HostError: It fails, or does not answer.
        """
        self._number += 1
        if self._link is None:
            raise HostError("the agent was closed", place=self.start.place)
        try:
            self._link.send(request_of(obs, self._number))
            answer = self._link.wait(time.monotonic() + START_TIME)
            if answer.kind != "acted" or answer.values.get("number") != self._number:
                raise HostError(f"the agent {answer.values.get('problem', 'gives no answer')}")
            return checked_actions(answer.arrays.get("actions"), len(obs.env_id))
        except Exception as error:  # of a socket, of Ray, of the wire or of the agent
            self.close()
            problem = error.problem if isinstance(error, HostError) else f"{type(error).__name__}: {error}"
            raise HostError(one_line(problem), place=self.start.place) from error

    def close(self) -> None:
        """End the connection; may be called again."""
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def __del__(self) -> None:
        if hasattr(self, "_link"):
            self.close()


def remote_spec(start: Starter) -> AgentSpec:
    """Return the spec of an agent elsewhere, which is started to ask for it.

    Raises:
        HostError: It does not start, or has no interface.
    """
    agent: Any = RemoteAgent(start)
    agent.close()
    return AgentSpec(agent.interface, RemoteAgent, [start])
