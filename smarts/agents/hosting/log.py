"""Logs of what agents elsewhere have decided, and in time: from one, a run is repeated exactly without them.

A decision is found by the agent's seed, which is a function of the run's seed, the world, the episode and the
agent's name, and by the step: so a log fits any number of simulations and processes. Runs that play the same
episodes need a folder each: a folder with two answers to one question is refused.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from smarts.agents.acting import Failed, Request, part_of
from smarts.agents.hosting.options import HostError
from smarts_agent_kit.wire import Message, WireError, decode, encode, frame_size

SUFFIX = ".decisions"
"""Of the files of a folder, one for each process and policy."""
LATE = "late"

Actions = NDArray | Sequence[Any]


class DecisionLog:
    """Writes the decisions of one policy.

    Args:
        folder: The logs of one run's processes and policies share one.

    Raises:
        HostError: It cannot be written.
    """

    def __init__(self, folder: str | Path) -> None:
        file = Path(folder) / f"{uuid.uuid4().hex}{SUFFIX}"
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = file.open("wb")
        except OSError as error:
            raise HostError(f"cannot be written: {error.strerror}", place=f"log {str(folder)!r}") from error

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
        self._file.close()

    def _write(self, kind: str, request: Request, values: Any, arrays: Any = None) -> None:
        batch = request.batch
        message = Message(kind, values, {"seed": batch.seed, "step": batch.step, **(arrays or {})})
        with suppress(OSError):  # a full disk does not end the run; the replay names what is missing
            self._file.write(encode(message))
            self._file.flush()


class Replayed:
    """Answers as a log says, and asks no agent.

    Args:
        folder: Of the log.

    Raises:
        HostError: There is none, or it holds two answers to one question.
    """

    link = None

    def __init__(self, folder: str | Path) -> None:
        self._place = f"replay {str(folder)!r}"
        self._found: dict[tuple[int, int], Any] = {}
        self._answers: list[tuple[Request, Actions]] = []
        files = sorted(Path(folder).glob(f"*{SUFFIX}"))
        if not files:
            remedy = "name the folder of a `log`"
            raise HostError("holds no decisions", place=self._place, remedy=remedy)
        for file in files:
            for message in messages_of(file):
                self._add(message)

    def open(self) -> None:
        """Do nothing."""

    def join(self) -> None:
        """Do nothing."""

    def ask(self, request: Request) -> None:
        """Answer a request, but for agents whose answer was late."""
        batch = request.batch
        keys = zip(batch.seed.tolist(), batch.step.tolist(), strict=True)
        missing = Failed("the log has no decision of this step")
        found = [self._found.get(key, missing) for key in keys]
        in_time = np.array([each is not LATE for each in found], np.bool_)
        if in_time.any():
            self._answers.append((part_of(request, in_time), [each for each in found if each is not LATE]))

    def take(self) -> list[tuple[Request, Actions]]:
        """Return the answers since the last call."""
        taken, self._answers = self._answers, []
        return taken

    def end(self) -> None:
        """Do nothing."""

    def _add(self, message: Message) -> None:
        arrays, values = message.arrays, message.values
        seeds, steps = arrays["seed"].tolist(), arrays["step"].tolist()
        if message.kind == "acted":
            results: Sequence[Any] = [*arrays["actions"]]
        else:
            problem = values.get("problem")
            results = [LATE if values.get(LATE) else Failed(str(problem))] * len(seeds)
        for key, result in zip(zip(seeds, steps, strict=True), results, strict=True):
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


def messages_of(file: Path) -> Iterator[Message]:
    """Yield the messages of a file; the last one may have been cut off."""
    content, place = file.read_bytes(), 0
    while place + 4 <= len(content):
        try:
            size = frame_size(content[place : place + 4])
            if place + size > len(content):
                return
            yield decode(content[place : place + size])
        except WireError as error:
            raise HostError(f"is no log: {error}", place=str(file)) from error
        place += size
