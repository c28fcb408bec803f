"""One recorded episode as dense arrays, made once for all metrics.

Axis letters: T instants (steps + 1), V vehicles, A agents, P planned paths, K lanes of a path, D decisions.
A vehicle that is not recorded at an instant is not `present` and has NaN and -1 there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.lane_paths import PathBook, path_book
from smarts.errors import RecordError
from smarts.geometry.frames import wrap_angle
from smarts.sim.episode_files import MAPS, RecordedEpisode
from smarts.types.agent_states import AgentStatus
from smarts.types.episode_schema import TABLES

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Found = TypeVar("Found")

_NUMBERS = {
    "x": "x",
    "y": "y",
    "heading": "heading",
    "speed": "speed",
    "acceleration": "acceleration",
    "lateral_acceleration": "lateral_acceleration",
    "s": "s",
    "t": "t",
    "desired_speed": "desired_speed",
}
_ON_LANES = ("s", "t")
"""Columns of the vehicles that mean nothing off the lanes."""
_FINITE = (*sorted(set(_NUMBERS) - {*_ON_LANES}), "length", "width")
"""Other columns of the vehicles on which metrics rely."""
_DRIVING = (int(AgentStatus.ACTIVE), int(AgentStatus.DONE))


class VehicleTracks(NamedTuple):
    """All vehicles at all instants, shape (T, V), and their sizes."""

    present: Bools
    x: Floats
    """[m]"""
    y: Floats
    heading: Floats
    """[rad]"""
    speed: Floats
    """[m/s]"""
    acceleration: Floats
    """[m/s^2]"""
    lateral_acceleration: Floats
    s: Floats
    """Along the lane [m]."""
    t: Floats
    """From the lane's middle, positive to the left [m]."""
    desired_speed: Floats
    """[m/s]"""
    turn: Floats
    """Heading as against that of the lane [rad]."""
    lane: Ints
    path: Ints
    """Planned path, row of `Paths`; -1 without a lane."""
    length: Floats
    """[m], shape (V,)."""
    width: Floats
    """[m], shape (V,)."""
    odometer: Floats
    """Distance driven while recorded [m]; stays where it is afterwards."""


class Paths(NamedTuple):
    """Planned paths."""

    lane: Ints
    """-1 beyond the last, shape (P, K)."""
    begin: Floats
    """How far into the path each lane begins [m], shape (P, K)."""


class Lanes(NamedTuple):
    """The lanes of a map, shape (L,)."""

    edge: Ints
    width: Floats
    """[m]"""
    left: Ints
    right: Ints
    kind: NDArray[np.int8]


@dataclass(frozen=True)
class Decisions:
    """What one agent chose, in order, shape (D,)."""

    step: Ints
    action: Ints
    """An `ActionSpaceType`."""
    values: Floats
    """Shape (D, 8)."""
    action_mask: Ints
    """Bit i: lane action i was allowed."""
    is_effective: Bools


class EpisodeData:
    """A recorded episode for metrics.

    Args:
        episode: On disk.
        split: "train" for variations that were trained on, "held_out" for the scenario's others; it only
            matters to generalization.

    Raises:
        RecordError: A table is missing or damaged.
        MapError: The map is missing.
    """

    def __init__(self, episode: RecordedEpisode, split: str = "train") -> None:
        self.split = split
        self._shared: dict[Callable, Any] = {}
        _check_columns(episode)
        self.facts: dict[str, Any] = episode.facts
        self.dt = float(self.facts["dt"])
        self.steps = int(self.facts["steps"])
        is_ego = episode.table("agents")["interface"] < 0
        self.agents = {name: column[is_ego] for name, column in episode.table("agents").items()}
        """The egos: agents of the pool are measured as traffic."""
        self.count = len(self.agents["agent_id"])
        """A, the number of agents."""
        self._vehicles = episode.table("vehicles")
        states = episode.table("agent_states")
        are_all = is_ego.all() and np.array_equal(self.agents["agent_id"], np.arange(self.count))
        if are_all and not (states["state"] == AgentStatus.LEAVING).any():
            self._agent_states = states
            self._decisions, self._extras = episode.table("decisions"), episode.table("extras")
        else:
            self._agent_states, self._decisions, self._extras = (
                _of_egos(episode.table(name), self.agents) for name in ("agent_states", "decisions", "extras")
            )
        self._routes = episode.table("routes")
        self.book: PathBook = path_book(episode.folder.parent / MAPS / f"{self.facts['map']}.npz")
        graph = self.book.graph
        self.graph = graph
        self.lanes = Lanes(graph.lane_edge, graph.width, graph.left, graph.right, graph.kind)
        self._check(str(episode.folder))

    def _check(self, place: str) -> None:
        """Raise if an index in the episode is out of range."""
        ranges = (
            ("vehicles", self._vehicles["step"], 0, self.steps),
            ("vehicles", self._vehicles["lane"], -1, len(self.graph.lane_ids) - 1),
            ("agent_states", self._agent_states["step"], 0, self.steps),
            ("agent_states", self._agent_states["agent_id"], 0, self.count - 1),
            ("decisions", self._decisions["step"], 0, self.steps),
            ("agents", self.agents["goal_lane"], -1, len(self.graph.lane_ids) - 1),
            ("agents", self.agents["entry_step"], -1, self.steps),
            ("agents", self.agents["end_step"], -1, self.steps),
        )
        for table, numbers, low, high in ranges:
            if len(numbers) and not low <= int(numbers.min()) <= int(numbers.max()) <= high:
                raise RecordError(
                    f"a number in table '{table}' is not between {low} and {high}",
                    place=place,
                    remedy="record the episode again",
                )
        on_lane = self._vehicles["lane"] >= 0
        numbers = {name: self._vehicles[name] for name in _FINITE}
        numbers |= {name: self._vehicles[name][on_lane] for name in _ON_LANES}
        numbers["distance_travelled"] = self.agents["distance_travelled"]
        for name, each in numbers.items():
            if not np.isfinite(each).all():
                raise RecordError(
                    f"a number in column '{name}' is not finite",
                    place=place,
                    remedy="record the episode again",
                )

    def shared(self, find: Callable[[EpisodeData], Found]) -> Found:
        """Return what a function finds in this episode; it is called once."""
        if find not in self._shared:
            self._shared[find] = find(self)
        return self._shared[find]

    @cached_property
    def entered(self) -> Bools:
        """Which agents took part, shape (A,)."""
        return self.agents["entry_step"] >= 0

    @cached_property
    def duration(self) -> Floats:
        """How long each agent drove [s], shape (A,)."""
        return np.where(self.entered, self.agents["end_step"] - self.agents["entry_step"], 0) * self.dt

    @cached_property
    def _keys(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the vehicles as single numbers, and the column of each row of the table."""
        table = self._vehicles
        keys = _key(table["slot"], table["generation"])
        return np.unique(keys, return_inverse=True)

    @cached_property
    def own(self) -> Ints:
        """Column of each agent's vehicle, -1 where it has none, shape (A,)."""
        return self.column(self.agents["slot"], self.agents["generation"])

    def column(self, slot: NDArray, generation: NDArray) -> Ints:
        """Return the column of vehicles, -1 for those that are not recorded."""
        known, keys = self._keys[0], _key(slot, generation)
        if not len(known):
            return np.full(len(keys), -1, np.int32)
        place = np.minimum(np.searchsorted(known, keys), len(known) - 1)
        return np.where((known[place] == keys) & (slot >= 0), place, -1).astype(np.int32)

    @cached_property
    def partner(self) -> Ints:
        """Column of the vehicle that each agent collided with, -1 without one, shape (A,)."""
        return self.column(self.agents["partner_slot"], self.agents["partner_generation"])

    @cached_property
    def kind(self) -> Ints:
        """A `VehicleKind` of each column of `motion`, shape (V,)."""
        kind = np.zeros(len(self._keys[0]), np.int32)
        kind[self._keys[1]] = self._vehicles["kind"]
        return kind

    @cached_property
    def driving(self) -> Bools:
        """When each agent drove, the instants of entry and end included, shape (T, A)."""
        driving = np.zeros((self.steps + 1, self.count), np.bool_)
        rows = np.isin(self._agent_states["state"], _DRIVING)
        driving[self._agent_states["step"][rows], self._agent_states["agent_id"][rows]] = True
        return driving

    def agent_column(self, name: str) -> Floats:
        """Return a column of the table `agents`, NaN where there is none, shape (T, A)."""
        dense = np.full((self.steps + 1, self.count), np.nan)
        dense[self._agent_states["step"], self._agent_states["agent_id"]] = self._agent_states[name]
        return dense

    @cached_property
    def motion(self) -> VehicleTracks:
        """All vehicles."""
        table, (known, columns) = self._vehicles, self._keys
        shape = self.steps + 1, len(known)
        steps = table["step"]
        dense: dict[str, NDArray] = {name: np.full(shape, np.nan) for name in _NUMBERS}
        for name, source in _NUMBERS.items():
            dense[name][steps, columns] = table[source]
        present = np.zeros(shape, np.bool_)
        present[steps, columns] = True
        lane, path, turn = (np.full(shape, each) for each in (np.int32(-1), np.int32(-1), np.nan))
        lane[steps, columns] = table["lane"]
        path[steps, columns] = self._path_rows
        turn[steps, columns] = self._turns()
        length, width = np.zeros(len(known)), np.zeros(len(known))
        length[columns], width[columns] = table["length"], table["width"]
        moved = np.hypot(np.diff(dense["x"], axis=0), np.diff(dense["y"], axis=0))
        odometer = np.zeros(shape)
        np.cumsum(np.nan_to_num(moved), axis=0, out=odometer[1:])
        return VehicleTracks(
            present=present, lane=lane, path=path, turn=turn, length=length, width=width, odometer=odometer,
            **dense,
        )  # fmt: skip

    @cached_property
    def _plans(self) -> tuple[list[int], Ints]:
        """Return the distinct planned paths as numbers of the book, and the row of each vehicle's row."""
        table, (_, columns) = self._vehicles, self._keys
        lanes = len(self.graph.lane_ids)
        goal = np.full(len(self._keys[0]), -1)
        agents = np.flatnonzero(self.own >= 0)
        goal[self.own[agents]] = self.agents["goal_lane"][agents]
        base = (table["route"].astype(np.int64) + 1) * (lanes + 1) + goal[columns] + 1
        code = base * (lanes + 1) + table["lane"] + 1
        found, rows = np.unique(code, return_inverse=True)
        edges = {
            int(number): tuple(each.tolist())
            for number, each in zip(self._routes["route"], self._routes["edges"], strict=True)
        }
        numbers: list[int] = []
        for each in found.tolist():
            rest, lane = divmod(each, lanes + 1)
            route, end = divmod(rest, lanes + 1)
            is_somewhere = lane > 0
            plan = lane - 1, edges.get(route - 1, ()), end - 1
            numbers.append(self.book.number(plan) if is_somewhere else -1)
        return numbers, rows.astype(np.int32)

    @property
    def _path_rows(self) -> Ints:
        numbers, rows = self._plans
        return np.where(np.array(numbers, np.int32)[rows] >= 0, rows, -1) if len(rows) else rows

    @cached_property
    def book_numbers(self) -> list[int]:
        """Number in the book of each row of `paths`, -1 for none."""
        return self._plans[0]

    @cached_property
    def paths(self) -> Paths:
        """The planned paths of this episode."""
        chosen = [self.book.paths[number] if number >= 0 else None for number in self.book_numbers]
        most = max((len(path.lanes) for path in chosen if path), default=1)
        lane, begin = np.full((len(chosen), most), -1, np.int32), np.zeros((len(chosen), most))
        for row, path in enumerate(chosen):
            if path:
                lane[row, : len(path.lanes)] = path.lanes
                begin[row, : len(path.begins)] = path.begins
        return Paths(lane, begin)

    def _turns(self) -> Floats:
        """Return the heading of each row of the table as against its lane's [rad]."""
        graph, table = self.graph, self._vehicles
        lane = np.maximum(table["lane"], 0)
        # One ascending axis for all lanes: arc lengths stay below a lane's share of it.
        share = float(graph.length.max()) + 1.0
        owner = np.repeat(np.arange(len(graph.length)), np.diff(graph.point_start))
        stations = owner * share + graph.point_s
        wanted = lane * share + np.clip(table["s"], 0.0, graph.length[lane])
        row = np.clip(np.searchsorted(stations, wanted, side="right") - 1, 0, len(stations) - 1)
        turn = -wrap_angle(graph.point_heading[row] - table["heading"])
        return np.where(table["lane"] >= 0, turn, np.nan)

    def decisions(self, agent: int) -> Decisions:
        """Return what one agent chose."""
        table = self._decisions
        rows = np.flatnonzero(table["agent_id"] == agent)
        rows = rows[np.argsort(table["step"][rows], kind="stable")]
        return Decisions(
            step=table["step"][rows],
            action=table["action"][rows],
            values=np.stack([table[f"value_{number}"][rows] for number in range(8)], axis=-1),
            action_mask=table["action_mask"][rows],
            is_effective=table["is_effective"][rows],
        )

    def extras(self, agent: int, name: str) -> dict[int, Floats]:
        """Return what the algorithm said of one agent's decisions, by step."""
        table = self._extras
        rows = np.flatnonzero((table["agent_id"] == agent) & (table["name"] == name))
        return {int(table["step"][row]): np.asarray(table["values"][row], float) for row in rows}


def _of_egos(table: Mapping[str, NDArray], egos: Mapping[str, NDArray]) -> Mapping[str, NDArray]:
    """Return the rows of the egos, from entry to end, with the ego's number in place of its column.

    Columns have other agents, too, and in training in bubbles several egos in turn.
    """

    def place(agent_id: NDArray, step: NDArray) -> NDArray[np.int64]:
        """Return numbers in the order of columns, then steps."""
        return agent_id.astype(np.int64) * 2**32 + step

    begins = place(egos["agent_id"], egos["entry_step"])
    if not len(begins):
        return {name: column[:0] for name, column in table.items()}
    order = np.argsort(begins, kind="stable")
    found = np.searchsorted(begins[order], place(table["agent_id"], table["step"]), side="right") - 1
    number = order[found]
    is_own = (found >= 0) & (table["agent_id"] == egos["agent_id"][number])
    is_own &= table["step"] <= egos["end_step"][number]
    return {name: column[is_own] for name, column in table.items()} | {"agent_id": number[is_own]}


def _check_columns(episode: RecordedEpisode) -> None:
    for table in TABLES:
        absent = set(table.names) - set(episode.table(table.name))
        if absent:
            raise RecordError(
                f"table '{table.name}' has no column '{min(absent)}'",
                place=str(episode.folder),
                remedy="record the episode again",
            )


def _key(slot: NDArray, generation: NDArray) -> NDArray[np.int64]:
    return slot.astype(np.int64) << 32 | generation.astype(np.int64)
