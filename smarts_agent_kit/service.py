"""Answers the simulator's messages with an agent."""

from __future__ import annotations

import importlib
import sysconfig
import traceback
from collections.abc import Callable, Mapping
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts_agent_kit.agents import ActionBatch
from smarts_agent_kit.wire import Message, WireError, encode, is_sent

FAILURES = (Exception, SystemExit)
"""What an agent may raise that lets it fail: `sys.exit` in an agent does not end the run."""
LONGEST_PROBLEM = 1000
"""Characters of a failure that are shown."""
_LIBRARIES = ("<frozen", *(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")))
SEEN = "observations/"
"""Begins the names of observations among the arrays of a request."""
FIELDS = ActionBatch._fields[1:]
"""The other arrays of a request."""
_fields_of = itemgetter(*FIELDS)

Make = Callable[[Mapping[str, Any]], tuple[Any, Mapping[str, Any]]]
"""Values of a `make` message -> an agent, and plain values that describe it."""


class WrongActionsError(Exception):
    """An agent has answered by something else than numbers for each vehicle."""


def checked_actions(answer: Any, count: int) -> NDArray:
    """Return an agent's answer as an array of numbers, shape (count, ...).

    Raises:
        WrongActionsError: The answer is no such array.
    """
    actions = np.asarray(answer)
    if not is_sent(actions.dtype):
        raise WrongActionsError(f"answered by an array of type {actions.dtype}: give numbers")
    if actions.shape[:1] != (count,):
        raise WrongActionsError(f"answered {count} agents by an array of shape {actions.shape}")
    return actions


def problem_of(error: BaseException) -> str:
    """Return what an agent has raised, as failures name it, with the file and line of its code."""
    place = _place_of(error)
    where = f" ({one_line(place)})" if place else ""
    return one_line(f"raised {type(error).__name__}: {error}", LONGEST_PROBLEM - len(where)) + where


def _place_of(error: BaseException) -> str:
    """Return file and line of the innermost call that is of no library, "" if there is none.

    The first call is left out: it is the one that asks the agent.
    """
    places = [
        f"{frame.filename}:{frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)[1:]
        if not frame.filename.startswith(_LIBRARIES)
    ]
    return places[-1] if places else ""


def one_line(text: str, longest: int = LONGEST_PROBLEM) -> str:
    """Return an agent's text as one line of some printable characters at most."""
    words = " ".join(text[:longest].split())
    escaped = (
        each if each.isprintable() else each.encode("unicode_escape").decode("ascii") for each in words
    )
    return "".join(escaped)[:longest].strip()


class Service:
    """Answers the messages of one connection.

    Args:
        make: Makes the agent.
    """

    def __init__(self, make: Make) -> None:
        self._make, self._agent = make, None

    def answer(self, message: Message) -> bytes:
        """Return the bytes of the answer; what the agent raises is part of it.

        Raises:
            WireError: The message is no request.
        """
        if message.kind == "make":
            return self._made(message.values)
        if message.kind != "act" or self._agent is None:
            raise WireError(f"{message.kind!r} is no request at this point")
        number = message.number
        batch = batch_of(message)
        try:
            actions = checked_actions(self._agent.act(batch), len(batch.env_id))
            return encode(Message("acted", {}, {"actions": actions}, number))
        except WrongActionsError as error:
            problem = str(error)
        except FAILURES as error:
            problem = problem_of(error)
        return encode(Message("failed", {"problem": problem}, {}, number))

    def _made(self, values: Mapping[str, Any]) -> bytes:
        try:
            self._agent, about = self._make(values)
            return encode(Message("about", about))
        except FAILURES as error:
            self._agent = None
            return encode(Message("failed", {"problem": problem_of(error)}))


def request_of(batch: ActionBatch, number: int) -> Message:
    """Return the message that asks for the actions of a batch."""
    arrays = {SEEN + name: array for name, array in batch.observations.items()}
    arrays.update(zip(FIELDS, batch[1:], strict=True))
    return Message("act", {}, arrays, number)


def batch_of(message: Message) -> ActionBatch:
    """Return the batch of a request.

    Raises:
        WireError: An array is missing.
    """
    arrays = message.arrays
    try:
        others = _fields_of(arrays)
    except KeyError as error:
        raise WireError(f"the request has no {error}") from error
    seen = {name[len(SEEN) :]: array for name, array in arrays.items() if name.startswith(SEEN)}
    return ActionBatch(seen, *others)


def describe(agent: Any) -> dict[str, Any]:
    """Return what the simulator has to know of an agent."""
    return {
        "observation": getattr(agent, "observation", "benchmark"),
        "period": getattr(agent, "period", 1),
        "interface": getattr(agent, "interface", None),
    }


def load(values: Mapping[str, Any]) -> tuple[Any, Mapping[str, Any]]:
    """Make the agent that `values["agent"]` names as "module:Class", with `values["options"]` as keywords.

    Raises:
        ValueError: The name has another form, or the agent has no method `act`.
    """
    module, colon, name = str(values.get("agent")).partition(":")
    if not colon:
        raise ValueError(f"{module!r} is not the 'module:Class' of an agent")
    found: Any = importlib.import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    agent = found(**values.get("options", {}))
    if not callable(getattr(agent, "act", None)):
        raise ValueError(f"{agent!r:.200} has no method act")
    return agent, describe(agent)
