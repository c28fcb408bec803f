"""Messages for viewers from what a publisher sends: of each simulation the newest frame and what lasts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from smarts.errors import RecordError
from smarts.stream.container import Message
from smarts.stream.encoder import EpisodeEncoder
from smarts.stream.tables import LASTING, OUTCOMES, STATIC, Columns
from smarts.types.episode_schema import EXTRAS, NAMES, TABLE


class LiveEncoder:
    """One episode of one simulation.

    Args:
        road_map: The message of the map, with `origin`.
        facts: Facts of the episode.
        source: Id of the simulation.
        serial: Serial of the episode.
        before: The encoder that the simulation had before its process connected again.
    """

    def __init__(
        self,
        road_map: Message,
        facts: Mapping[str, Any],
        source: str,
        serial: int,
        before: LiveEncoder | None = None,
    ) -> None:
        self.serial = serial
        x, y = road_map["origin"]
        self._stamp = {"source": source, "serial": serial}
        self._encoder = EpisodeEncoder(road_map, (x, y), facts, self._stamp)
        if before is not None and before.serial == serial:
            # Viewers know the vehicles of this episode by their numbers.
            self._encoder.number_as(before._encoder)
        self._tables: dict[str, Columns] = {}
        """Tables without steps."""
        self._lasting: dict[str, dict[int, tuple]] = {name: {} for name in LASTING}
        """The newest rows of what holds until it changes, by lane or bubble."""
        self._newest: tuple[int, dict[str, dict[str, Any]]] | None = None
        """Step and tables of the newest frame."""
        self._end: list[dict[str, Any]] = []

    def opening(self) -> list[dict[str, Any]]:
        """Return the messages of the episode and its map."""
        return self._encoder.opening()

    def take(self, message: dict[str, Any], *, is_watched: bool) -> list[dict[str, Any]]:
        """Take a message of the publisher; return what viewers get, no steps if no viewer shows the frame.

        Raises:
            RecordError: There is no such message.
        """
        match message["type"]:
            case "frame":
                tables = {str(name): _columns(name, data) for name, data in message["tables"].items()}
                return self._take_frame(int(message["step"]), tables, is_watched)
            case "end":
                self._end = self._encoder.end(bool(message["is_complete"]), str(message["remark"]))
                return self._end
            case other:
                raise RecordError(f"a message '{other}'", place=self._stamp["source"])

    def snapshot(self) -> list[dict[str, Any]]:
        """Return all that a new viewer needs: what lasts, and the newest frame."""
        # Vehicles keep the numbers that other viewers know them by.
        encoder = self._encoder.untold()
        made = [*encoder.opening(), *encoder.static(self._tables)]
        if self._newest is not None:
            step, tables = self._newest
            tables = {name: rows for name, rows in tables.items() if name != EXTRAS.name}
            for name, rows in self._lasting.items():
                if rows:
                    columns = zip(*((step, *row[1:]) for row in rows.values()), strict=True)
                    tables[name] = dict(zip(TABLE[name].names, columns, strict=True))
            made += encoder.chunk(np.array([step], np.int32), tables, is_live=True)
        return [*made, *self._end]

    def _take_frame(
        self, step: int, tables: dict[str, dict[str, Any]], is_watched: bool
    ) -> list[dict[str, Any]]:
        static = {each.name: tables.pop(each.name) for each in (*STATIC, OUTCOMES) if each.name in tables}
        self._tables |= static
        names = {NAMES.name: tables.pop(NAMES.name)} if NAMES.name in tables else {}
        made = self._encoder.static(static | names)
        for name, newest in self._lasting.items():
            newest |= {row[1]: row for row in zip(*tables.get(name, {}).values(), strict=True)}
        self._newest = step, tables
        if is_watched:
            made += self._encoder.chunk(np.array([step], np.int32), tables, is_live=True)
        vehicles = tables["vehicles"]
        self._encoder.forget_others(vehicles["slot"], vehicles["generation"])
        return made


def _columns(name: str, data: Any) -> dict[str, Any]:
    """Return the columns of a table, of rows of floating-point numbers or as they are."""
    if isinstance(data, bytes):
        table = TABLE[name]
        block = np.frombuffer(data, np.float64).reshape(-1, len(table.columns))
        with np.errstate(invalid="ignore"):
            return {
                each.name: block[:, number].astype(each.kind) for number, each in enumerate(table.columns)
            }
    # A list of numbers may come as the bytes of float32.
    return {
        str(column): [np.frombuffer(each, np.float32) if isinstance(each, bytes) else each for each in values]
        for column, values in data.items()
    }
