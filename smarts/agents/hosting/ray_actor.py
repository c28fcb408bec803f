"""Links to agents in Ray actors: one actor for each policy, on any node of the cluster."""

from __future__ import annotations

import importlib
import os
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import ray

from smarts.agents.hosting.options import HostError
from smarts_agent_kit.service import Service
from smarts_agent_kit.wire import Message, decode, encode


@ray.remote(num_cpus=0, max_restarts=0)
class _Actor:
    """Answers messages with an agent; the bytes are those of other links."""

    def __init__(self, module: str) -> None:
        self._service = Service(importlib.import_module(module).load)

    def answer(self, frame: bytes) -> bytes:
        """Return the answer to a message."""
        return self._service.answer(decode(frame))


class RayLink:
    """A link to an actor.

    Args:
        actor: Belongs to the link, which ends it.
    """

    def __init__(self, actor: Any) -> None:
        self._actor: Any = actor
        self._owner = os.getpid()
        self.about: Mapping[str, Any] | None = None
        self._answers: deque[Any] = deque()  # references

    def send(self, message: Message | bytes) -> None:
        """Send a message; see `Link`."""
        frame = encode(message) if isinstance(message, Message) else message
        self._answers.append(self._actor.answer.remote(frame))

    def receive(self) -> Message | None:
        """Return the next message; see `Link`."""
        return self._next(0.0)

    def wait(self, until: float) -> Message:
        """Return the next message; see `Link`."""
        message = self._next(max(0.0, until - time.monotonic()))
        if message is None:
            raise TimeoutError("no message has come in time")
        return message

    @staticmethod
    def wait_for(links: Sequence[RayLink], until: float) -> None:
        """Wait until one of several links can receive, or until a time."""
        answers = [link._answers[0] for link in links if link._answers]
        ray.wait(answers, timeout=max(0.0, until - time.monotonic()))

    def close(self) -> None:
        """End the actor; may be called again."""
        actor, self._actor = self._actor, None
        self._answers.clear()
        if actor is not None and self._owner == os.getpid() and ray.is_initialized():
            ray.kill(actor)

    def _next(self, seconds: float) -> Message | None:
        if not self._answers or not ray.wait([self._answers[0]], timeout=seconds)[0]:
            return None
        return decode(ray.get(self._answers.popleft()))


@dataclass(frozen=True)
class AsRayActor:
    """Starts an actor."""

    module: str
    """Has the function `load`, which makes the agent."""
    values: Mapping[str, Any]
    """Say which agent it makes."""
    place: str
    """Place that errors name."""

    def open(self) -> RayLink:
        """Start an actor; see `Starter`."""
        if not ray.is_initialized():
            raise HostError(
                "Ray is not running in this process", place=self.place, remedy="call ray.init() before"
            )
        link = RayLink(_Actor.remote(self.module))
        link.send(Message("make", self.values))
        return link
