"""The host of a run's social policies: some act in this process, others elsewhere."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from smarts.agents.acting import Actions, Answer, Failed, Late, Request, local_policy
from smarts.agents.hosting.links import SocketLink
from smarts.agents.hosting.options import HostError, HostOptions, Link, Starter, about, patience
from smarts.agents.policy import ActionBatch
from smarts.agents.social import SocialPolicy
from smarts_agent_kit.channel import ClosedError, wait_for
from smarts_agent_kit.service import WrongActionsError, checked_actions, one_line, request_of
from smarts_agent_kit.wire import Message, encode

MOST_SKIPPED = 63
"""Requests that a host fails at most before it is started again: 0, 1, 3, 7 ... after failures in a row."""


class Hosts:
    """Runs the social policies of a run, each where it has its place.

    All requests are sent before any answer is awaited; the policies of this process compute meanwhile. The
    others start when the first episode begins.

    Args:
        policies: The policies of the run.

    Raises:
        Exception: Whatever an agent of this process raises when it is made.
    """

    def __init__(self, policies: Sequence[SocialPolicy]) -> None:
        self._here = {number: local_policy(each) for number, each in enumerate(policies) if not each.start}
        self._hosted = {
            number: HostedPolicy(policy.start, policy.host)
            for number, policy in enumerate(policies)
            if policy.start
        }
        self._has_begun = False

    @property
    def links(self) -> dict[int, Link]:
        """The links that are open, by the policy's number."""
        return {number: each.link for number, each in self._hosted.items() if each.link is not None}

    def begin(self) -> None:
        """Start the agents that act elsewhere, all at once, unless they are there.

        Raises:
            HostError: One does not start.
        """
        if self._has_begun:
            return
        try:
            for each in self._hosted.values():
                each.open()
            for each in self._hosted.values():
                each.join()
        except BaseException:
            self.close()
            raise
        self._has_begun = True

    def dispatch(self, requests: Mapping[int, Request]) -> None:
        """Send all requests, without waiting."""
        for number, request in requests.items():
            (self._hosted.get(number) or self._here[number]).ask(request)

    def gather(self) -> Sequence[Answer]:
        """Return the answers to all requests, by the policy's number."""
        answers = [Answer(number, *taken) for number, here in self._here.items() for taken in here.take()]
        begun = time.monotonic()
        waiting = [each for each in self._hosted.values() if each.is_asked]
        while waiting:
            for each in wait_for_any(waiting, begun) or waiting:
                each.settle()
            waiting = [each for each in waiting if each.is_asked and not each.gives_up(begun)]
        for number, hosted in self._hosted.items():
            answers += [Answer(number, *taken) for taken in hosted.take()]
        return sorted(answers, key=lambda answer: answer.policy)

    def forget(self, rows: Collection[int]) -> None:
        """Drop the requests of some simulations, and the agents of this process there.

        What an agent elsewhere is still answering counts for holds that are over.
        """
        for here in self._here.values():
            here.forget(rows)

    def close(self) -> None:
        """End the policies and their processes; may be called again."""
        with ExitStack() as ends:  # an interrupt while one ends keeps no other
            for each in self._hosted.values():
                ends.callback(each.end)
            ends.callback(self._here.clear)


@dataclass
class _Asked:
    """A request in flight."""

    number: int
    request: Request
    sent: float
    """[s]"""
    is_late: bool = False


class _Opening(threading.Thread):
    """Opens a link again; in a thread where there is a deadline, as an address may keep a step waiting."""

    def __init__(self, starter: Starter) -> None:
        super().__init__(name="agent-opening", daemon=True)
        self._starter = starter
        self.link: Link | None = None
        self.error = Exception("it was not started")

    def run(self) -> None:
        """Open the link."""
        try:
            self.link = self._starter.open()
        except Exception as error:  # of a socket, of a process or of Ray
            self.error = error


class HostedPolicy:
    """A policy that acts elsewhere: asks it, takes its answers, and starts it again after a failure."""

    def __init__(self, starter: Starter, options: HostOptions) -> None:
        self._starter, self._options = starter, options
        self.link: Link | None = None
        self._opening: _Opening | None = None
        self._has_answered = False  # since it was started
        self._failures = self._skipped = 0  # failures in a row, requests since the last one
        self._problem = ""
        self._number = 0  # of the last request
        self._asked: deque[_Asked] = deque()
        self._answers: list[tuple[Request, Actions]] = []
        # The holds that the agent knows, by (env_id, agent_id).
        self._known: dict[tuple[int, int], int] = {}
        self._last_holds: tuple[bytes, ...] = ()  # of the last request

    @property
    def is_asked(self) -> bool:
        """Whether an answer is awaited in this step."""
        return bool(self._asked) and not self._asked[-1].is_late

    def open(self) -> None:
        """Start the agent, without waiting for it.

        Raises:
            HostError: It does not start.
        """
        self._use(self._starter.open())

    def _use(self, link: Link) -> None:
        self._known.clear()
        self._last_holds = ()
        self._has_answered = False
        self.link = link

    def join(self) -> None:
        """Wait until the agent is made.

        Raises:
            HostError: It is not.
        """
        assert self.link is not None
        about(self.link, self._starter.place)

    def ask(self, request: Request) -> None:
        """Send a request; while an answer that is late is owed, the agents of this request are late, too."""
        self.settle()
        if any(each.is_late for each in self._asked):
            self._note_late(request)
            return
        if self.link is None and not self._restart():
            if self._opening is not None:
                self._note_late(request)
            else:
                self._answer(request, _failed(request, self._problem))
            return
        self._number += 1
        asked = _Asked(self._number, request, time.monotonic())
        message = request_of(self._with_first(request.batch), self._number)
        try:
            frame = encode(message)
        except Exception as error:
            self._answer(request, _failed(request, f"cannot be asked: {error}"))
            return
        self._asked.append(asked)
        try:
            assert self.link is not None
            self.link.send(frame)
        except Exception as error:  # of a socket or of Ray
            self._fail(error)

    def gives_up(self, begun: float) -> bool:
        """Give up what is awaited no longer, in a step that began to wait at a time; return whether it is."""
        if time.monotonic() < self.until(begun):
            return False
        self.settle()  # an answer may have come while another agent was ended, or this process was stopped
        if not self.is_asked:
            return True
        if self._options.deadline_ms is None:
            self._fail(TimeoutError(f"silent for {time.monotonic() - begun:.3g} s"))
        for each in self._asked:
            if not each.is_late:
                each.is_late = True
                self._note_late(each.request)
        return True

    def until(self, begun: float) -> float:
        """Return until when answers are awaited, in a step that began to wait at a time."""
        deadline = self._options.deadline_ms
        if deadline is None:
            return begun + self._patience
        return min((each.sent for each in self._asked if not each.is_late), default=begun) + deadline / 1000.0

    def take(self) -> list[tuple[Request, Actions]]:
        """Return the answers that have come since the last call, with their requests."""
        taken, self._answers = self._answers, []
        return taken

    def end(self) -> None:
        """End the agent; may be called again."""
        opening, self._opening = self._opening, None
        if opening is not None and opening.link is not None:
            self._use(opening.link)
        self._close_link()

    def _close_link(self) -> None:
        self._asked.clear()
        link, self.link = self.link, None
        if link is not None:
            with suppress(Exception):  # of a process or of Ray: there is no agent any more
                link.close()

    def _answer(self, request: Request, actions: Actions) -> None:
        self._answers.append((request, actions))

    def _note_late(self, request: Request) -> None:
        self._answers.append((request, [Late()] * len(request.batch.env_id)))

    @property
    def _patience(self) -> float:
        return patience(self._options, has_answered=self._has_answered)

    def settle(self) -> None:
        """Take the answers that have arrived; drop late ones."""
        while self._asked and self.link is not None:
            try:
                message = self.link.receive()
                if message is None:
                    break
                self._take(message)
            except Exception as error:  # of a socket, of Ray, of the wire, or of the protocol
                self._fail(error)
        if self._asked and self._asked[0].is_late:
            owed = time.monotonic() - self._asked[0].sent
            if owed > self._patience:
                self._fail(TimeoutError(f"silent for {owed:.3g} s"))

    def _take(self, message: Message) -> None:
        """Take one answer.

        Raises:
            HostError: The message is no answer, or the agent could not be made, or its process has ended.
        """
        if self.link is not None and self.link.about is None and message.kind == "about":
            self.link.about = message.values
            return
        asked, values = self._asked[0], message.values
        if message.kind not in ("acted", "failed") or message.number != asked.number:
            raise HostError(one_line(str(values.get("problem", f"it has sent {message.kind!r}, no answer"))))
        if message.kind == "failed":
            actions = _failed(asked.request, str(values.get("problem")))
        else:
            try:
                actions = checked_actions(message.arrays.get("actions"), len(asked.request.batch.env_id))
            except WrongActionsError as error:
                actions = _failed(asked.request, str(error))
        self._has_answered, self._failures = True, 0
        self._asked.popleft()
        if not asked.is_late:
            self._answer(asked.request, actions)

    def _fail(self, error: Exception) -> None:
        """End an agent that does not answer; the agents of its requests fail, but for late ones."""
        asked = [each.request for each in self._asked if not each.is_late]
        at = f" at step {step_of(self._asked[0].request.batch)}" if self._asked else ""
        self._problem = f"its host has failed{at}: {_words(error)}"
        self._close_link()
        for request in asked:
            self._answer(request, _failed(request, self._problem))
        self._failures, self._skipped = self._failures + 1, 0

    def _restart(self) -> bool:
        """Start the agent again, unless it has failed too often of late; return whether it is there."""
        opening, deadline = self._opening, self._options.deadline_ms
        if opening is None:
            pause = min(2 ** (self._failures - 1) - 1, MOST_SKIPPED)
            if self._skipped < pause:
                self._skipped += 1
                return False
            opening = self._opening = _Opening(self._starter)
            if deadline is None:
                opening.run()
            else:
                # Without waiting: several addresses may be silent, and other agents are still to be asked.
                opening.start()
        if opening.is_alive():
            return False
        self._opening = None
        if opening.link is None:
            self._fail(opening.error)
        else:
            self._use(opening.link)
        return self.link is not None

    def _with_first(self, batch: ActionBatch) -> ActionBatch:
        """Return a batch in which the holds that the agent does not know are new ones."""
        holds = batch.env_id.tobytes(), batch.agent_id.tobytes(), batch.hold.tobytes()
        if holds == self._last_holds:
            return batch
        known, self._last_holds = self._known, holds
        is_first = batch.is_first.copy()
        places = zip(batch.env_id.tolist(), batch.agent_id.tolist(), batch.hold.tolist(), strict=True)
        for place, (env_id, agent_id, hold) in enumerate(places):
            is_first[place] |= known.get((env_id, agent_id)) != hold
            known[env_id, agent_id] = hold
        return batch._replace(is_first=is_first)


def _failed(request: Request, problem: str) -> list[Failed]:
    return [Failed(one_line(problem))] * len(request.batch.env_id)


def wait_for_any(waiting: Sequence[HostedPolicy], begun: float) -> Sequence[HostedPolicy]:
    """Wait until one of several policies can answer, or until one has to have answered.

    Returns:
        Those that can; none: not known, or the time is over.
    """
    until = min([each.until(begun) for each in waiting])
    channels = {each.link.channel: each for each in waiting if isinstance(each.link, SocketLink)}
    if channels:
        return [channels[each] for each in wait_for(channels, until)]
    links: list[Any] = [each.link for each in waiting]
    links[0].wait_for(links, until)
    return ()


def step_of(batch: ActionBatch) -> int:
    """Return the latest step of a request's episodes."""
    return int(np.max(batch.step, initial=0))


def _words(error: Exception) -> str:
    """Return what an error says; without its type, if it is one of hosts."""
    if isinstance(error, HostError):
        return error.problem
    is_plain = isinstance(error, ClosedError | TimeoutError) and str(error)
    return str(error) if is_plain else f"{type(error).__name__}: {error}"
