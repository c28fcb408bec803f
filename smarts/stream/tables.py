"""Facts and tables of an episode as messages, under the names of `smarts.types.episode_schema`."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.stream.arrays import packed_array
from smarts.stream.container import VERSION
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.agent_states import AgentStatus, ChangePhase
from smarts.types.episode_schema import (
    AGENT_FAILURES,
    AGENT_STATES,
    AGENTS,
    BUBBLE_POSES,
    BUBBLE_RINGS,
    BUBBLES,
    DECISIONS,
    EXTRAS,
    HOLDS,
    INTEGERS,
    NUMBERS,
    OBSERVATIONS,
    ROUTES,
    SIGNALS,
    TEXT,
    TRANSFERS,
    Column,
    Table,
)
from smarts.types.events import Event, Outcome
from smarts.types.mission import GoalKind
from smarts.types.traffic import Signal
from smarts.types.transfers import Reason, Refusal
from smarts.types.vehicles import Owner, VehicleKind

_AGENT = Column("agent", "int32", "row of the agent in agents, -1 where it is unknown")
OUTCOMES = Table(
    "outcomes",
    "a row for each agent whose episode ended",
    (
        _AGENT,
        Column("step", "int32", "that ended it"),
        Column("outcome", "int8", "Outcome"),
        Column("partner_slot", "int32", "vehicle that it collided with, -1 for none"),
        Column("partner_generation", "int32", "of that vehicle"),
    ),
)
"""The one table that recorded episodes do not have: there it is part of `agents`."""
STATIC = (AGENTS, HOLDS, ROUTES, BUBBLES, BUBBLE_RINGS)
"""The tables of an episode that are sent before its steps."""
_STEPPED = AGENT_STATES, DECISIONS, SIGNALS, EXTRAS, TRANSFERS, BUBBLE_POSES, AGENT_FAILURES, OBSERVATIONS
STEPPED = (
    *(replace(t, columns=(*t.columns, _AGENT)) if "agent_id" in t.names else t for t in _STEPPED),
    OUTCOMES,
)
"""Those whose rows are sent with their steps. Rows of an agent say which row of `agents` it is, since agents
may have an agent_id in turn."""
LASTING = SIGNALS.name, BUBBLE_POSES.name
"""Tables whose rows hold until the next one."""
LIVE: dict[str, tuple[str, ...]] = {
    AGENT_STATES.name: (
        *("step", "agent", "slot", "generation", "state", "events", "throttle", "brake", "steering"),
        *("route_progress", "remaining", "change_phase"),
    ),
    DECISIONS.name: ("step", "agent", "action", *(f"value_{n}" for n in range(8)), "action_mask"),
}
"""The columns that live streams have of large tables: what the page shows. Other tables have all."""
MOST_ROWS = 20_000
"""Largest number of rows of one message."""
MOST_LISTED = 4 << 20
"""Bytes of one message's lists of numbers, before compression; a row is never split."""

_ENUMERATIONS: tuple[type[enum.IntEnum] | type[enum.IntFlag], ...] = (
    *(Owner, Outcome, Event, VehicleKind, AgentStatus, ChangePhase, Signal),
    *(ActionSpaceType, LaneAction, Reason, Refusal, GoalKind),
)
_LISTS = {NUMBERS: np.dtype(np.float32), INTEGERS: np.dtype(np.int32)}

Columns = Mapping[str, Any]
"""Columns by name: arrays, or sequences, all of one length."""


def episode_message(facts: Mapping[str, Any], origin: tuple[float, float]) -> dict[str, Any]:
    """Return the first message of an episode.

    Args:
        facts: The row of the table `episode`, or what is known of it.
        origin: What positions of vehicles and lanes are relative to [m].
    """
    return {
        "type": "episode",
        "version": VERSION,
        "facts": {name: _plain(value) for name, value in facts.items()},
        "names": {
            each.__name__: {str(int(member)): str(member.name) for member in each.__members__.values()}
            for each in _ENUMERATIONS
        },
        "origin": list(origin),
    }


def table_messages(schema: Table, columns: Columns, *, append: bool = False) -> list[dict[str, Any]]:
    """Return the messages of a table, or of further rows of it."""
    arrays = {c.name: _typed(c.kind, columns[c.name]) for c in schema.columns if c.name in columns}
    rows = len(next(iter(arrays.values()))) if arrays else 0
    if any(len(each) != rows for each in arrays.values()):
        raise ValueError(f"table {schema.name}: columns of different lengths")
    return [
        {
            "type": "table",
            "name": schema.name,
            "append": append or begin > 0,
            "columns": {column: _column(each[begin:end]) for column, each in arrays.items()},
        }
        for begin, end in _parts(rows, arrays)
    ]


def columns_message(kind: str, columns: Columns) -> dict[str, Any]:
    """Return a message that has columns of its own, such as `vehicles`."""
    arrays = {name: each if isinstance(each, np.ndarray) else [*each] for name, each in columns.items()}
    return {"type": kind, **{name: _column(each) for name, each in arrays.items()}}


def _parts(rows: int, columns: Columns) -> list[tuple[int, int]]:
    """Return the first row and the row behind the last one of each message."""
    size = np.zeros(rows, np.int64)
    for column in columns.values():
        if isinstance(column, list) and column and isinstance(column[0], np.ndarray):
            size += [each.nbytes for each in column]
    until, parts, begin = np.append(0, np.cumsum(size)), [], 0
    while begin < rows or not parts:
        fits = int(np.searchsorted(until, until[begin] + MOST_LISTED, "right")) - 1
        end = min(max(fits, begin + 1), begin + MOST_ROWS, rows)
        parts.append((begin, end))
        begin = end
    return parts


def _typed(kind: str, values: Sequence[Any] | NDArray) -> Any:
    if kind == TEXT:
        return [str(each) for each in values]
    if kind in _LISTS:
        return [np.asarray(each, _LISTS[kind]) for each in values]
    return np.asarray(values).astype(kind)


def _column(values: Any) -> Any:
    """Return a column as it is in a message."""
    if isinstance(values, np.ndarray):
        return packed_array(values)
    if not values or isinstance(values[0], str):
        return values
    offsets = np.cumsum([0, *map(len, values)]).astype(np.uint32)
    return packed_array(np.concatenate(values)) | {"o": packed_array(offsets)}


def _plain(value: Any) -> Any:
    """Return a number or text that msgpack knows."""
    return value.item() if isinstance(value, np.generic) else value
