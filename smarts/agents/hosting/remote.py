"""Agents elsewhere, as agents of this process: to describe them, to test them, and to drive egos."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.hosting.facts import Facts, facts_from
from smarts.agents.hosting.options import HERE, HostError, HostOptions, Link, Starter, about, patience
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.agents.spec import AgentSpec
from smarts_agent_kit.channel import ClosedError
from smarts_agent_kit.service import checked_actions, is_ending, one_line, request_of
from smarts_agent_kit.wire import Message


class RemoteAgent(BatchAgent):
    """Asks an agent elsewhere, and waits for its answers.

    Args:
        start: Starts the agent, before the first request.
        facts: What the agent has said about itself.
        options: Say how long its answers are waited for.
    """

    # Each has its own.
    interface: Any  # pyright: ignore[reportIncompatibleVariableOverride]
    observation: Any  # pyright: ignore[reportIncompatibleVariableOverride]
    period: Any  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, start: Starter, facts: Facts, options: HostOptions = HERE) -> None:
        self.start, self.facts, self.options = start, facts, options
        self.interface, self.observation, self.period = facts
        self._link: Link | None = None
        self._number = 0
        self._is_closed = self._has_answered = False

    def act(self, obs: ActionBatch) -> NDArray:
        """Return the agent's actions.

        Raises:
            HostError: It fails, or does not answer.
        """
        self._number += 1
        if self._is_closed:
            raise HostError(
                "the agent was closed, or has failed before", place=self.start.place, remedy="make it again"
            )
        if self._link is None:
            self._link = self.start.open()
        try:
            about(self._link, self.start.place)
            self._link.send(request_of(obs, self._number))
            answer = self._answer()
            if answer.kind != "acted" or answer.number != self._number:
                raise HostError(f"the agent {answer.values.get('problem', 'gives no answer')}")
            actions = checked_actions(answer.arrays.get("actions"), len(obs.env_id))
        except Exception as error:  # of a socket, of Ray, of the wire or of the agent
            self.close()
            place = f"{self.start.place}, step {step_of(obs)}"
            raise HostError(
                one_line(words(error)), place=place, remedy="see what the agent has printed"
            ) from error
        self._has_answered = True
        return actions

    def _answer(self) -> Message:
        """Wait for the answer to a request.

        Raises:
            HostError: No answer comes in time, or the agent has ended.
        """
        assert self._link is not None
        seconds = patience(self.options, has_answered=self._has_answered)
        try:
            answer = self._link.wait(time.monotonic() + seconds)
        except TimeoutError as error:
            raise HostError(f"the agent is silent for {seconds:g} s") from error
        if is_ending(answer):
            raise HostError(f"the agent has ended: {answer.values.get('problem')}")
        return answer

    def close(self) -> None:
        """End the agent; may be called again."""
        link, self._link, self._is_closed = self._link, None, True
        if link is not None:
            link.close()

    def __del__(self) -> None:
        if getattr(self, "_link", None) is not None:
            self.close()


def step_of(batch: ActionBatch) -> int:
    """Return the latest step of a request's episodes."""
    return int(np.max(batch.step, initial=0))


def words(error: Exception) -> str:
    """Return what an error says; without its type, if it is one of hosts."""
    is_plain = isinstance(error, ClosedError | TimeoutError) and str(error)
    said = error.problem if isinstance(error, HostError) else str(error)
    return said if is_plain or isinstance(error, HostError) else f"{type(error).__name__}: {said}"


def remote_spec(start: Starter) -> AgentSpec:
    """Return the spec of an agent elsewhere, which is started to ask for it.

    Raises:
        HostError: It does not start, or has no interface.
    """
    link = start.open()
    try:
        facts = facts_from(about(link, start.place), start.place)
    finally:
        link.close()
    return AgentSpec(facts.interface, RemoteAgent, [start, facts])
