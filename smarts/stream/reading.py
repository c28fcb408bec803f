"""Compact episodes, read in Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from smarts.arrays import Floats
from smarts.errors import RecordError
from smarts.stream.container import VERSION, Message, messages_in
from smarts.stream.motion import Motion, motion_of
from smarts.stream.tables import columns_of, values_of

_VEHICLES = ("number", "slot", "generation", "name", "kind", "length", "width")


class CompactEpisode:
    """The content of a compact episode; a file that was cut has what is before the cut.

    Args:
        data: The bytes.
        only_static: Whether to read only what is before the first steps.

    Raises:
        RecordError: They are damaged, or of another version of the format.
    """

    def __init__(self, data: bytes, *, only_static: bool = False) -> None:
        messages = messages_in(data)
        first = next(messages, None)
        if first is None or first["type"] != "episode":
            raise _bad("it does not begin with the message 'episode'", "bring the file back from a copy")
        check_version(first)
        try:
            self.facts: dict[str, Any] = dict(first.get("facts", {}))
            """The row of the table `episode`."""
            x, y = map(float, first.get("origin", (0.0, 0.0)))
        except (TypeError, ValueError) as error:
            raise _bad(f"its first message is damaged: {error}", "bring the file back from a copy") from error
        self.origin: Floats = np.array([x, y])
        """What the positions in `motion` are relative to [m]."""
        self.map: Message | None = None
        """The message of the map."""
        self.tables: dict[str, dict[str, Any]] = {}
        """Columns by the name of the table."""
        self.vehicles: dict[str, Any] = dict.fromkeys(_VEHICLES, np.zeros(0, np.int32)) | {"name": []}
        """What does not change of vehicles, by column."""
        self.is_whole = False
        """Whether the file is not cut."""
        self._motions: list[Motion] = []
        for message in messages:
            if only_static and message["type"] == "steps":
                break
            self._take(message)

    @classmethod
    def load(cls, path: Path, *, only_static: bool = False) -> CompactEpisode:
        """Read a file.

        Raises:
            RecordError: It cannot be read, is damaged, or of another version.
        """
        try:
            return cls(path.read_bytes(), only_static=only_static)
        except OSError as error:
            raise _bad(f"it cannot be read: {error.strerror}", "check its name", str(path)) from error
        except RecordError as error:
            raise RecordError(error.problem, place=str(path), remedy=error.remedy) from error

    @property
    def motion(self) -> Motion:
        """The rows of all vehicles, message by message."""
        empty = Motion._make([np.zeros(0, np.int32)] * len(Motion._fields))
        return Motion._make(np.concatenate(each) for each in zip(*(self._motions or [empty]), strict=True))

    def _take(self, message: dict[str, Any]) -> None:
        match message["type"]:
            case "map":
                self.map = message
            case "table":
                self._take_table(message)
            case "vehicles":
                new = {name: values_of(message, name) for name in _VEHICLES}
                self.vehicles = {name: _joined(self.vehicles[name], new[name]) for name in _VEHICLES}
            case "steps":
                self._motions.append(motion_of(message))
            case "end":
                self.is_whole = True

    def _take_table(self, message: dict[str, Any]) -> None:
        name, columns = str(message.get("name")), columns_of(message)
        if message.get("append") and name in self.tables:
            columns = {
                column: _joined(self.tables[name][column], more)
                for column, more in columns.items()
                if column in self.tables[name]
            }
        self.tables[name] = columns


def check_version(message: Message) -> None:
    """Check that a message `episode` is of this version of the format.

    Raises:
        RecordError: It is not.
    """
    if message.get("version") != VERSION:
        raise _bad(
            f"written in format {message.get('version')!r}, this program reads format {VERSION}",
            "use the version of smarts-bench that wrote it, or make it again",
        )


def _joined(before: Any, more: Any) -> Any:
    return [*before, *more] if isinstance(before, list) else np.concatenate([before, more])


def _bad(problem: str, remedy: str, place: str = "the compact episode") -> RecordError:
    return RecordError(problem, place=place, remedy=remedy)
