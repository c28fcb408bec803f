"""Where an agent acts, and in what time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Protocol

from pydantic import Field

from smarts.agents.checks import InterfaceError, Plain, checked
from smarts.errors import SmartsError
from smarts_agent_kit.service import one_line
from smarts_agent_kit.wire import Message

IN_PROCESS, PROCESS, RAY = "in_process", "process", "ray"
ADDRESS = "tcp://"
"""Begins the locator of an agent that is served at an address."""
OTHERS = "*"
"""Stands for all agents that `hosts` does not name."""
LONGEST_DELAY = 100
"""Steps."""


class HostError(SmartsError):
    """An agent's process or address does not start, is refused, or has no agent that can act there."""


class Link(Protocol):
    """A connection to an agent elsewhere, which carries messages."""

    about: Mapping[str, Any] | None
    """What the agent has said about itself; None: nothing yet."""

    def send(self, message: Message | bytes) -> None:
        """Send a message, or its bytes, or as much of it as goes without waiting."""
        ...

    def receive(self) -> Message | None:
        """Return the next message, None if it is not here yet; sends what is left.

        Raises:
            Exception: The agent is gone, or what it sends is no message.
        """
        ...

    def wait(self, until: float) -> Message:
        """Return the next message, waiting until a time of `time.monotonic()`.

        Raises:
            TimeoutError: No message has come by then.
            Exception: As `receive`.
        """
        ...

    def close(self) -> None:
        """End the connection, and the process behind it if it is this one's; may be called again."""
        ...


class Starter(Protocol):
    """Starts an agent elsewhere, or connects to it."""

    @property
    def place(self) -> str:
        """What is started, for errors."""
        ...

    def open(self) -> Link:
        """Return a link to an agent of this link's own; the first message from it is `about`, or `failed`.

        Raises:
            HostError: There is no such agent.
        """
        ...


START_TIME = 60.0
"""How long an agent may take to be made, and to answer for the first time [s]."""


def patience(options: HostOptions, *, has_answered: bool) -> float:
    """Return how long an answer is waited for [s].

    The first one takes longer: imports, compilation, memory.
    """
    return options.patience if has_answered else max(START_TIME, options.patience)


def about(link: Link, place: str) -> Mapping[str, Any]:
    """Return what the agent behind a link says about itself; waits for it if the link is new.

    Raises:
        HostError: It cannot be made, or is silent.
    """
    if link.about is not None:
        return link.about
    try:
        message = link.wait(time.monotonic() + START_TIME)
    except Exception as error:  # of a socket, of Ray, of the wire
        raise HostError(
            f"the agent does not start: {error}", place=place, remedy="see what it has printed"
        ) from error
    if message.kind != "about":
        problem = one_line(str(message.values.get("problem", f"it has sent {message.kind!r}")))
        raise HostError(
            f"the agent cannot be made: {problem}",
            place=place,
            remedy="mend it, or its options, where it runs",
        )
    link.about = message.values
    return message.values


@checked
class HostOptions:
    """Where an agent's policy acts, and in what time.

    Raises:
        InterfaceError: A value is not what it has to be.
    """

    PLACE: ClassVar = "hosts"

    where: Literal["in_process", "process", "ray"] = IN_PROCESS
    """"in_process", "process" (on this machine) or "ray" (an actor). Agents at an address have their place:
    for them the default stands for it."""
    patience: Annotated[float, Plain, Field(gt=0, le=3600)] = 10.0
    """How long an answer is waited for before the agent's host is ended and started again [s]; the first one
    of a process for `START_TIME` at least."""
    deadline_ms: Annotated[float, Plain, Field(gt=0, le=3.6e6)] | None = None
    """Answers that come later than this after the question are dropped [ms]; None: each is waited for."""
    delay_steps: Annotated[int, Plain, Field(ge=0, le=LONGEST_DELAY)] = 0
    """Steps from an answer to when it is carried out."""
    memory: Annotated[float, Plain, Field(ge=0.1, le=1e6)] = 8.0
    """Memory limit of a process [GB]; less than 0.1 does not suffice for Python and NumPy."""

    def __post_init__(self) -> None:
        if self.deadline_ms is not None and self.delay_steps:
            raise InterfaceError(
                f"deadline_ms is {self.deadline_ms:g}, and delay_steps is {self.delay_steps}",
                place="hosts",
                remedy="give one of them: a deadline in time, or a delay in steps",
            )


HERE = HostOptions()

HostsByLocator = Mapping[str, HostOptions]
"""Options by locator; `OTHERS` stands for all that are not named."""


def hosts_of(given: Mapping[str, HostOptions | str | Mapping[str, Any]]) -> dict[str, HostOptions]:
    """Return where agents act, by locator; each is given as itself, a dict of its fields or its `where`.

    Raises:
        InterfaceError: A field is not what it can be.
    """
    options = {
        locator: {"where": entry} if isinstance(entry, str) else entry for locator, entry in given.items()
    }
    return {
        locator: entry if isinstance(entry, HostOptions) else HostOptions(**entry)
        for locator, entry in options.items()
    }


def host_of(hosts: HostsByLocator, locator: str) -> HostOptions:
    """Return where an agent acts."""
    return hosts.get(locator, hosts.get(OTHERS, HERE))
