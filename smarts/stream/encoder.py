"""The one way from rows of a recorded episode's tables to messages: for files and for live streams."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Ints, Longs
from smarts.geometry.frames import wrap_angle
from smarts.stream.arrays import unpacked_array, unpacked_runs
from smarts.stream.container import Message
from smarts.stream.motion import (
    AIR_LOCK,
    BRAKES,
    COLLIDED,
    LEAVING,
    LEFT,
    RIGHT,
    Motion,
    steps_message,
)
from smarts.stream.tables import (
    LIVE,
    OUTCOMES,
    STATIC,
    STEPPED,
    Columns,
    columns_message,
    episode_message,
    table_messages,
)
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode_schema import AGENT_STATES
from smarts.types.events import Event

Tables = Mapping[str, Mapping[str, Any]]
"""Columns by the names of tables and columns."""

BRAKING = -0.5
"""Vehicles show their brake lights at this acceleration or below [m/s^2]."""
TURN_ANGLE = 0.4
"""Vehicles show a turn indicator on a way through a junction that bends by more [rad]."""
_BRAKE = 0.05
"""An agent shows its brake lights at this position of the pedal."""
_FINEST = 256
"""Numbers of `agent_states` are rounded to this part of their unit: random bits do not get smaller."""


class EpisodeEncoder:
    """Makes the messages of one episode, in order of time.

    Args:
        road_map: The message of the map.
        origin: What positions are relative to [m].
        facts: The row of the table `episode`, or what is known of it at the beginning.
        stamp: Keys of every message: live, `source` and `serial`.
    """

    def __init__(
        self,
        road_map: Message,
        origin: tuple[float, float],
        facts: Mapping[str, Any],
        stamp: Mapping[str, Any] | None = None,
    ) -> None:
        self._map, self._facts = road_map, dict(facts)
        self._stamp = dict(stamp or {})
        self._origin = np.array(origin)
        self._numbers: dict[int, int] = {}
        self._next = itertools.count()
        self._told: set[int] = set()
        self._names: dict[int, str] = {}
        self._collided: set[int] = set()
        self._indicators = turn_indicators(road_map["lanes"])
        self._holds = _Holds({"agent_id": (), "first_step": (), "agent": ()})

    def opening(self) -> list[dict[str, Any]]:
        """Return the messages of the episode and its map."""
        episode = episode_message(self._facts, (float(self._origin[0]), float(self._origin[1])))
        return self._stamped([episode, self._map])

    def static(self, tables: Tables) -> list[dict[str, Any]]:
        """Return the messages of tables without steps; remember the vehicles' names and who holds what."""
        if "names" in tables:
            names = tables["names"]
            keys = _key(names["slot"], names["generation"]).tolist()
            self._names |= dict(zip(keys, names["name"], strict=True))
        if "agents" in tables:
            self._holds = _Holds(tables["holds"] if "holds" in tables else _kept_columns(tables["agents"]))
        return self._stamped(
            [
                message
                for table in (*STATIC, OUTCOMES)
                if table.name in tables
                for message in table_messages(table, tables[table.name])
            ]
        )

    def chunk(self, steps: Ints, tables: Tables, *, is_live: bool = False) -> list[dict[str, Any]]:
        """Return the messages of some steps.

        Args:
            steps: Their numbers, increasing, shape (K,).
            tables: The rows of these steps; tables without rows may be missing.
            is_live: Whether viewers get them now: without time spent on compression, and without the columns
                that the page does not show.
        """
        messages = []
        for table in STEPPED:
            columns = tables.get(table.name, {})
            if not columns or not len(next(iter(columns.values()))):
                continue
            if "agent_id" in columns and "agent" not in columns:
                agents = self._holds.agents(columns["agent_id"], columns["step"])
                columns = {**columns, "agent": agents}
            if table.name == AGENT_STATES.name:
                columns = {name: _rounded(column) for name, column in columns.items()}
            if is_live and table.name in LIVE:
                columns = {name: columns[name] for name in LIVE[table.name] if name in columns}
            messages += table_messages(table, columns, append=True)
        vehicles = tables["vehicles"]
        keys = _key(vehicles["slot"], vehicles["generation"])
        messages += self._newcomers(keys, vehicles)
        number = np.array([self._numbers[key] for key in keys.tolist()], np.int64)
        flags, steering = self._of_agents(number, vehicles, tables.get(AGENT_STATES.name))
        x, y = (np.stack([vehicles["x"], vehicles["y"]], -1) - self._origin).T
        heading, speed = vehicles["heading"], vehicles["speed"]
        motion = Motion(number, vehicles["step"], x, y, heading, speed, steering, flags)
        return self._stamped([*messages, steps_message(steps, motion, compress=not is_live)])

    def forget_others(self, slot: NDArray, generation: NDArray) -> None:
        """Forget all vehicles but some: the others do not come back."""
        kept = set(_key(slot, generation).tolist())
        for known in (self._numbers, self._names):
            for key in known.keys() - kept:
                del known[key]
        self._told &= kept
        self._collided &= set(self._numbers.values())

    def untold(self) -> EpisodeEncoder:
        """Return an encoder for one more reader, which numbers and names vehicles as this one does."""
        other = copy(self)
        other._told, other._collided = set(), set(self._collided)
        return other

    def number_as(self, other: EpisodeEncoder) -> None:
        """Number and name vehicles as another encoder of the episode does."""
        self._numbers, self._names, self._next = other._numbers, other._names, other._next
        self._collided, self._holds = set(other._collided), other._holds

    def end(self, is_complete: bool, remark: str) -> list[dict[str, Any]]:
        """Return the last message."""
        return self._stamped([{"type": "end", "is_complete": bool(is_complete), "remark": str(remark)}])

    def _newcomers(self, keys: Longs, rows: Columns) -> list[dict[str, Any]]:
        """Number the vehicles that are new; return what is to be known of them."""
        found, first = np.unique(keys, return_index=True)
        is_new = np.array([key not in self._told for key in found.tolist()], np.bool_)
        if not is_new.any():
            return []
        new, at = found[is_new], first[is_new]
        self._told |= set(new.tolist())
        for key in new.tolist():
            if key not in self._numbers:
                self._numbers[key] = next(self._next)
        numbers = np.array([self._numbers[key] for key in new.tolist()], np.uint32)
        columns = {
            "number": numbers,
            **{name: rows[name][at].astype(np.int32) for name in ("slot", "generation")},
            "name": [self._names.get(key, "") for key in new.tolist()],
            "kind": rows["kind"][at].astype(np.uint8),
            **{name: rows[name][at].astype(np.float32) for name in ("length", "width")},
        }
        return [columns_message("vehicles", columns)]

    def _of_agents(
        self, number: Longs, vehicles: Columns, states: Columns | None
    ) -> tuple[NDArray[np.uint16], NDArray]:
        """Return the flags and the steering angles of rows [rad], shape (N,) each."""
        step = np.asarray(vehicles["step"])
        flags, lane = np.asarray(vehicles["owner"]).astype(np.uint16), np.asarray(vehicles["lane"])
        flags |= self._indicators[np.where((lane >= 0) & (lane < len(self._indicators) - 1), lane, -1)]
        flags[np.asarray(vehicles["acceleration"]) <= BRAKING] |= BRAKES
        steering = np.zeros(len(step))
        since = {number: -1 for number in self._collided}
        if states is not None and len(states["step"]):
            row, found = self._rows_of(states, number, step)
            is_active = states["state"] == AgentStatus.ACTIVE
            observes = states["state"] == AgentStatus.SHADOWING
            leaves = (states["state"] == AgentStatus.LEAVING) | (
                is_active & (states["release_step"] != UNSET)
            )
            drives = found & ~observes
            steering[row[drives]] = states["steering"][drives]
            # A vehicle has one agent in a step, so no row is chosen twice.
            for bit, chosen in (
                (AIR_LOCK, found & observes),
                (LEAVING, found & leaves),
                (BRAKES, drives & (states["brake"] > _BRAKE)),
            ):
                flags[row[chosen]] |= bit
            since = self._collisions(states) | since
        if since:
            begins = np.array([since.get(each, np.iinfo(np.int32).max) for each in number.tolist()])
            flags[step >= begins] |= COLLIDED
        self._collided |= since.keys()
        return flags, steering

    def _rows_of(self, states: Columns, number: Longs, step: NDArray) -> tuple[Longs, NDArray[np.bool_]]:
        """Return the row of each agent's vehicle, and whether there is one."""
        if not len(step):
            none = np.zeros(len(states["step"]), np.int64)
            return none, none > 0
        keys = _key(states["slot"], states["generation"]).tolist()
        held = np.array([self._numbers.get(key, UNSET) for key in keys], np.int64)
        order = np.lexsort((step, number))
        at, wanted = _key(number, step)[order], _key(held, states["step"])
        place = np.minimum(np.searchsorted(at, wanted), len(at) - 1)
        return order[place], (held >= 0) & (at[place] == wanted)

    def _collisions(self, states: Columns) -> dict[int, int]:
        """Return the first step in which each vehicle collides, by number."""
        collided = (np.asarray(states["events"]).astype(np.int64) & int(Event.COLLISION)) != 0
        since: dict[int, int] = {}
        for slot, generation in (("slot", "generation"), ("partner_slot", "partner_generation")):
            keys = _key(states[slot][collided], states[generation][collided]).tolist()
            for key, step in zip(keys, states["step"][collided].tolist(), strict=True):
                if key in self._numbers:
                    number = self._numbers[key]
                    since[number] = min(since.get(number, int(step)), int(step))
        return since

    def _stamped(self, messages: Sequence[Message]) -> list[dict[str, Any]]:
        return [{**message, **self._stamp} for message in messages]


def turn_indicators(lanes: Mapping[str, Any]) -> NDArray[np.uint16]:
    """Return the turn indicators of each lane as bits of `Motion.flags`, shape (L + 1,); the last is 0."""
    start = unpacked_array(lanes["start"]).astype(np.int64)
    x, y = (unpacked_runs(lanes[name], start[:-1]) for name in "xy")
    heading = np.arctan2(np.diff(y), np.diff(x))
    has_line = np.diff(start) >= 2
    first, last = np.where(has_line, start[:-1], 0), np.where(has_line, start[1:] - 2, 0)
    bend = wrap_angle(heading[last] - heading[first])
    is_turn = has_line & (unpacked_array(lanes["junction"]) == 1) & (np.abs(bend) > TURN_ANGLE)
    return np.append(np.where(is_turn, np.where(bend > 0.0, LEFT, RIGHT), 0), 0).astype(np.uint16)


class _Holds:
    """Which agent has each column, since when."""

    def __init__(self, holds: Columns) -> None:
        at = _key(np.asarray(holds["agent_id"]), np.asarray(holds["first_step"]))
        order = np.argsort(at, kind="stable")
        self._at, self._agent = at[order], np.asarray(holds["agent"])[order]

    def agents(self, agent_id: NDArray, step: NDArray) -> Longs:
        """Return the agents that have columns in some steps, -1 where there is none."""
        if not len(self._at):
            return np.full(len(agent_id), UNSET, np.int64)
        place = np.searchsorted(self._at, _key(np.asarray(agent_id), np.asarray(step)), "right") - 1
        is_known = (place >= 0) & (self._at[place] >> 32 == agent_id)
        return np.where(is_known, self._agent[place], UNSET)


def _kept_columns(agents: Columns) -> Columns:
    """Return holds for an episode that has none: agents keep their columns."""
    rows = np.flatnonzero(np.asarray(agents["agent_id"]) >= 0)
    return {
        "agent_id": np.asarray(agents["agent_id"])[rows],
        "first_step": np.zeros(len(rows)),
        "agent": rows,
    }


def _key(high: NDArray, low: NDArray) -> Longs:
    return (np.asarray(high).astype(np.int64) << 32) + np.asarray(low).astype(np.int64)


def _rounded(column: NDArray) -> NDArray:
    if column.dtype.kind != "f":
        return column
    return (np.rint(column.astype(np.float64) * _FINEST) / _FINEST).astype(column.dtype)
