"""Messages for viewers from what a publisher sends: of each simulation the newest frame and what lasts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.errors import RecordError
from smarts.stream.container import Message
from smarts.stream.encoder import EpisodeEncoder
from smarts.stream.tables import OUTCOMES, Columns, table_messages
from smarts.types.episode_schema import AGENT_STATES, BUBBLE_POSES, DECISIONS, SIGNALS, VEHICLES, Table

_BLOCKS = VEHICLES, AGENT_STATES, DECISIONS
_OUTCOME = OUTCOMES.names[1:]
_STATIC = "agents", "holds", "routes", "bubbles", "bubble_rings"


class _Frame(NamedTuple):
    """A publisher's frame."""

    step: int
    tables: dict[str, Columns]
    """Rows of vehicles, agent_states, decisions, extras and observations."""
    signals: dict[int, int]
    """Light of each lane that shows one."""
    poses: list[tuple[float, ...]]
    """x, y, angle and whether it is active of each bubble."""


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
        self._static: dict[str, Columns] = {}
        self._outcomes: Columns = {}
        self._frame: _Frame | None = None
        self._shown = _Frame(-1, {}, {}, [])
        self._end: list[dict[str, Any]] = []

    def opening(self) -> list[dict[str, Any]]:
        """Return the messages of the episode and its map."""
        return self._encoder.opening()

    def take(self, message: dict[str, Any], *, is_watched: bool) -> list[dict[str, Any]]:
        """Take a message of the publisher; return what viewers get, nothing if no viewer shows the frame.

        Raises:
            RecordError: There is no such message.
        """
        match message["type"]:
            case "static":
                return self._take_static(message["tables"])
            case "frame":
                return self._take_frame(message, is_watched)
            case "end":
                self._end = self.end(bool(message["is_complete"]), str(message["remark"]))
                return self._end
            case other:
                raise RecordError(f"a message '{other}'", place=self._stamp["source"])

    def end(self, is_complete: bool, remark: str) -> list[dict[str, Any]]:
        """Return the last message."""
        return self._encoder.end(is_complete, remark)

    def snapshot(self) -> list[dict[str, Any]]:
        """Return all that a new viewer needs: what lasts, and the newest frame."""
        # Vehicles keep the numbers that other viewers know them by.
        encoder = self._encoder.untold()
        made = [*encoder.opening(), *encoder.static(self._static), *self._ended(self._outcomes, append=False)]
        if self._frame is not None:
            shown = _Frame(-1, {}, {}, [])
            tables = {name: rows for name, rows in self._frame.tables.items() if name != "extras"}
            made += _encoded(encoder, self._frame._replace(tables=tables), shown)
            self._shown = self._frame
        return [*made, *self._end]

    def _take_static(self, tables: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Take tables that last; return those that have changed, and of outcomes the new ones."""
        before = self._static
        self._static = {name: dict(tables[name]) for name in _STATIC if tables.get(name)}
        changed = {name for name, table in self._static.items() if table != before.get(name)}
        if changed & {"agents", "holds"}:
            # They belong together.
            changed |= {"agents", "holds"} & self._static.keys()
        made = self._encoder.static({name: self._static[name] for name in changed})
        known = len(self._outcomes.get("agent", ()))
        self._outcomes = {name: [*tables["outcomes"][name]] for name in ("agent", *_OUTCOME)}
        new = {name: values[known:] for name, values in self._outcomes.items()}
        return [*made, *self._ended(new, append=known > 0)]

    def _take_frame(self, message: dict[str, Any], is_watched: bool) -> list[dict[str, Any]]:
        names = [(int(slot), int(generation), str(name)) for slot, generation, name in message["names"]]
        if names:
            slots, generations, texts = zip(*names, strict=True)
            self._encoder.static({"names": {"slot": slots, "generation": generations, "name": texts}})
        self._frame = frame = self._read(message)
        made = _encoded(self._encoder, frame, self._shown) if is_watched else []
        if is_watched:
            self._shown = frame
        vehicles = frame.tables["vehicles"]
        self._encoder.forget_others(vehicles["slot"], vehicles["generation"])
        return made

    def _read(self, message: dict[str, Any]) -> _Frame:
        """Return a publisher's frame."""
        step = int(message["step"])
        tables: dict[str, dict[str, Any]] = {
            table.name: _rows(table, data) for table, data in zip(_BLOCKS, message["rows"], strict=True)
        }
        tables["extras"] = _extras(message["extras"])
        tables["observations"] = _observations(message.get("observations", ()))
        agents = np.array([*map(int, message["agent"])], np.int64)
        for rows in tables.values():
            if "agent_id" in rows:
                rows["agent"] = agents[np.asarray(rows["agent_id"], np.int64)]
        signals = {int(lane): int(light) for lane, light in message["signals"]}
        poses = [(float(x), float(y), float(angle), float(on)) for x, y, angle, on in message["bubbles"]]
        return _Frame(step, {**tables}, signals, poses)

    def _ended(self, outcomes: Columns, *, append: bool) -> list[dict[str, Any]]:
        """Return the messages of rows of outcomes."""
        if not outcomes.get("agent"):
            return []
        return [{**made, **self._stamp} for made in table_messages(OUTCOMES, outcomes, append=append)]


def _encoded(encoder: EpisodeEncoder, frame: _Frame, before: _Frame) -> list[dict[str, Any]]:
    """Return the messages of a frame; of lights and bubbles what is not as it was."""
    tables, step = dict(frame.tables), frame.step
    both = {**before.signals, **frame.signals}
    changed = {lane: frame.signals.get(lane, 0) for lane in both}
    changed = {lane: light for lane, light in changed.items() if light != before.signals.get(lane, 0)}
    if changed:
        columns = [step] * len(changed), [*changed], [*changed.values()]
        tables[SIGNALS.name] = dict(zip(SIGNALS.names, columns, strict=True))
    old = before.poses
    moved = [number for number, pose in enumerate(frame.poses) if old[number : number + 1] != [pose]]
    if moved:
        rows = [(step, number, *frame.poses[number]) for number in moved]
        tables[BUBBLE_POSES.name] = dict(
            zip(BUBBLE_POSES.names, map(list, zip(*rows, strict=True)), strict=True)
        )
    return encoder.chunk(np.array([step], np.int32), tables, is_live=True)


def _rows(table: Table, data: Any) -> dict[str, Any]:
    """Return the columns of rows of floating-point numbers."""
    block: Floats = np.frombuffer(data, np.float64).reshape(-1, len(table.columns))
    with np.errstate(invalid="ignore"):
        return {c.name: block[:, number].astype(c.kind) for number, c in enumerate(table.columns)}


def _extras(extras: Any) -> dict[str, Any]:
    rows = [
        (int(step), int(agent), str(name), [*map(float, values)])
        for name, step, agents, table in extras
        for agent, values in zip(agents, table, strict=True)
    ]
    columns = zip(*rows, strict=True) if rows else ((), (), (), ())
    return dict(zip(("step", "agent_id", "name", "values"), map(list, columns), strict=True))


def _observations(given: Any) -> dict[str, Any]:
    rows = [
        (int(step), int(agent), str(name), np.frombuffer(values, np.float32))
        for step, agent, name, values in given
    ]
    columns = zip(*rows, strict=True) if rows else ((), (), (), ())
    return dict(zip(("step", "agent_id", "name", "values"), map(list, columns), strict=True))
