"""Agents elsewhere, as agents of this process: to describe them, to test them, and to drive egos."""

from __future__ import annotations

import time
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.acting import Request
from smarts.agents.hosting.facts import Facts, facts_from
from smarts.agents.hosting.hosts import HostedPolicy, step_of, wait_for_any
from smarts.agents.hosting.options import HERE, HostError, Starter, about
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.agents.spec import AgentSpec


class RemoteAgent(BatchAgent):
    """Asks an agent elsewhere, and waits for its answers.

    Args:
        start: Starts the agent, before the first request.
        facts: What the agent has said about itself.
    """

    # Each has its own.
    interface: Any  # pyright: ignore[reportIncompatibleVariableOverride]
    observation: Any  # pyright: ignore[reportIncompatibleVariableOverride]
    period: Any  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, start: Starter, facts: Facts) -> None:
        self.start, self.facts = start, facts
        self.interface, self.observation, self.period = facts
        self._hosted: HostedPolicy | None = HostedPolicy(start, HERE)

    def act(self, obs: ActionBatch) -> NDArray:
        """Return the agent's actions.

        Raises:
            HostError: It fails, or does not answer.
        """
        hosted, place = self._hosted, self.start.place
        if hosted is None:
            raise HostError("the agent was closed, or has failed before", place=place, remedy="make it again")
        if hosted.link is None:
            hosted.open()
            hosted.join()
        begun = time.monotonic()
        hosted.ask(Request(obs))
        while hosted.is_asked and not hosted.gives_up(begun):
            wait_for_any([hosted], begun)
            hosted.settle()
        ((_, actions),) = hosted.take()
        if not isinstance(actions, np.ndarray):
            self.close()
            problem = next((failed.problem for failed in actions), "it does not answer")
            remedy = "see what the agent has printed"
            raise HostError(problem, place=f"{place}, step {step_of(obs)}", remedy=remedy)
        return actions

    def close(self) -> None:
        """End the agent; may be called again."""
        hosted, self._hosted = self._hosted, None
        if hosted is not None:
            hosted.end()

    def __del__(self) -> None:
        if getattr(self, "_hosted", None) is not None:
            self.close()


def remote_spec(start: Starter) -> AgentSpec:
    """Return the spec of an agent elsewhere, which is started to ask for it.

    Raises:
        HostError: It does not start, or has no interface.
    """
    with closing(start.open()) as link:
        facts = facts_from(about(link, start.place), start.place)
    return AgentSpec(facts.interface, RemoteAgent, [start, facts])
