"""Logs of what agents elsewhere have decided, and in time: from one, a run is repeated exactly without them.

A file begins with what the agent has said about itself: a replay starts, reaches and asks no agent. A
decision is found by the agent's seed, which is a function of the run's seed, the world, the episode and the
agent's name, and by the step: so a log fits any number of simulations and processes. Runs that play the same
episodes need a folder each: a folder with two answers to one question is refused.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.acting import Failed, Late, Request
from smarts.agents.hosting.options import HostError
from smarts.shipped import local
from smarts_agent_kit.wire import Message, WireError, decode, encode, frame_size

SUFFIX = ".decisions"
"""Of the files of a folder, one for each process and policy."""
LATE = "late"
AGENT, OPTIONS, ABOUT = "agent", "options", "about"
"""Of the first message of a file: whose decisions these are, and what the agent has said about itself."""

REMEDY = "name the folder of a `log` of this agent, of a run with the same version of this project"
FILE_REMEDY = f"remove the file, or {REMEDY}"

Actions = NDArray | Sequence[Any]


class DecisionLog:
    """Writes the decisions of one policy.

    Args:
        folder: The logs of one run's processes and policies share one.
        agent: The agent's locator.
        options: The arguments of its policy, as `Wanted` has them.

    Raises:
        HostError: No file can be made in the folder.
    """

    def __init__(self, folder: str | Path, agent: str = "", options: str = "") -> None:
        self._folder, self._agent, self._options = Path(folder), agent, options
        self._file: BinaryIO | None = None
        """None: before `begin`, and when nothing is written any more."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._error(error.strerror) from error

    def begin(self, about: Mapping[str, Any]) -> None:
        """Make the file, and write what the agent has said about itself.

        Raises:
            HostError: The file cannot be made.
        """
        values = {AGENT: self._agent, OPTIONS: self._options, ABOUT: dict(about)}
        try:
            self._file = (self._folder / f"{uuid.uuid4().hex}{SUFFIX}").open("xb")
        except OSError as error:
            raise self._error(error) from error
        self._append(encode(Message("about", values)))

    def write(self, request: Request, actions: Actions) -> None:
        """Write the answer to a request."""
        if isinstance(actions, np.ndarray):
            self._write("acted", request, {}, {"actions": actions})
        else:
            self._write("failed", request, {"problem": next(iter(actions)).problem})

    def write_late(self, request: Request) -> None:
        """Write that the answer to a request has not come in time."""
        self._write("failed", request, {LATE: True})

    def close(self) -> None:
        """Close the file; may be called again."""
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):
                file.close()

    def _write(self, kind: str, request: Request, values: Any, arrays: Any = None) -> None:
        batch = request.batch
        if self._file is not None:
            arrays = {"seed": batch.seed, "step": batch.step, **(arrays or {})}
            self._append(encode(Message(kind, values, arrays)))

    def _append(self, frame: bytes) -> None:
        """Write a message; if the disk is full, the log ends here, and its replay says what is missing."""
        assert self._file is not None
        try:
            self._file.write(frame)
            self._file.flush()
        except OSError:
            self.close()

    def _error(self, problem: object) -> HostError:
        return HostError(
            f"cannot be written: {problem}",
            place=f"log {str(self._folder)!r}",
            remedy="name a folder in which files can be made",
        )


class Replayed:
    """Answers as a log says, and asks no agent.

    Args:
        folder: Of the log.
        agent: The agent's locator.
        options: The arguments of its policy, as `Wanted` has them.

    Raises:
        HostError: It holds no decisions of the agent, or two answers to one question, or is no log.
    """

    link = None

    def __init__(self, folder: str | Path, agent: str = "", options: str = "") -> None:
        self._place = place_of(folder)
        self._found: dict[tuple[int, int], Any] = {}
        self._answers: list[tuple[Request, Actions]] = []
        found = recorded(folder)
        mine = [each for each in found if (each.agent, each.options) == (agent, options)]
        if not mine:
            raise not_recorded(folder, found, agent, options)
        for each in mine:
            for message in islice(messages_of(each.file), 1, None):
                self._add(message)

    def open(self) -> None:
        """Do nothing."""

    def join(self) -> None:
        """Do nothing."""

    def ask(self, request: Request) -> None:
        """Answer a request."""
        batch = request.batch
        keys = zip(batch.seed.tolist(), batch.step.tolist(), strict=True)
        missing = Failed("the log has no decision of this step")
        self._answers.append((request, [self._found.get(key, missing) for key in keys]))

    def take(self) -> list[tuple[Request, Actions]]:
        """Return the answers since the last call."""
        taken, self._answers = self._answers, []
        return taken

    def end(self) -> None:
        """Do nothing."""

    def _add(self, message: Message) -> None:
        keys = zip(message.arrays["seed"].tolist(), message.arrays["step"].tolist(), strict=True)
        for key, result in zip(keys, _decisions(message), strict=True):
            if not _is_same(self._found.setdefault(key, result), result):
                raise HostError(
                    f"holds two decisions of the agent's seed {key[0]} at step {key[1]}",
                    place=self._place,
                    remedy="log each run, and each test of an experiment, into a folder of its own",
                )


def _is_same(one: Any, other: Any) -> bool:
    """Return whether two decisions are the same, bit by bit."""
    if isinstance(one, np.ndarray | np.generic) and isinstance(other, np.ndarray | np.generic):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    return type(one) is type(other) and one == other


def _decisions(message: Message) -> Sequence[Any]:
    """Return the decisions of a message's agents."""
    if message.kind == "acted":
        return [*message.arrays["actions"]]
    failed = Late() if message.values.get(LATE) else Failed(str(message.values["problem"]))
    return [failed] * len(message.arrays["seed"])


class Recorded(NamedTuple):
    """Whose decisions a file of a log holds."""

    file: Path
    agent: str
    """Its locator."""
    options: str
    """As `Wanted` has them."""
    about: Mapping[str, Any]
    """What the agent has said about itself."""


def recorded(folder: str | Path) -> list[Recorded]:
    """Return whose decisions the files of a log hold; a file that ends in its first message is left out.

    Raises:
        HostError: No file holds any, or one is no log.
    """
    try:
        files = sorted(each for each in local(folder).iterdir() if each.suffix == SUFFIX)
    except OSError as error:
        raise HostError(f"cannot be read: {error.strerror}", place=place_of(folder), remedy=REMEDY) from error
    found = [each for each in map(_recorded, files) if each is not None]
    if not found:
        raise HostError("holds no decisions", place=place_of(folder), remedy=REMEDY)
    return found


def _recorded(file: Path) -> Recorded | None:
    first = next(messages_of(file), None)
    if first is None:
        return None
    return Recorded(file, *(first.values[name] for name in (AGENT, OPTIONS, ABOUT)))


def not_recorded(folder: str | Path, found: Sequence[Recorded], agent: str, options: str) -> HostError:
    """Return the error for an agent of which a log holds no decisions."""
    known = sorted({f"{each.agent} {each.options}" for each in found})
    return HostError(
        f"holds no decisions of {agent!r} with the options {options}, but of {', '.join(known)}",
        place=place_of(folder),
        remedy=REMEDY,
    )


def place_of(folder: str | Path) -> str:
    """Return the place of a log, for errors."""
    return f"replay {str(folder)!r}"


def messages_of(file: Path) -> Iterator[Message]:
    """Yield the messages of a file; the last one may have been cut off.

    Raises:
        HostError: It is no log, or cannot be read.
    """
    try:
        with file.open("rb") as content:
            while len(start := content.read(4)) == 4:
                frame = start + content.read(frame_size(start) - 4)
                if len(frame) < frame_size(start):
                    return
                yield decode(frame)
    except (OSError, WireError) as error:
        raise HostError(f"is no log: {error}", place=str(file), remedy=FILE_REMEDY) from error
