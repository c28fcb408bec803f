"""Recorded episodes as compact episodes: what a browser plays."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Ints
from smarts.errors import RecordError, SmartsError
from smarts.sim.episode_files import RecordedEpisode
from smarts.stream.container import framed
from smarts.stream.encoder import EpisodeEncoder
from smarts.stream.road_map import map_message, origin_of
from smarts.stream.tables import LASTING, OUTCOMES, STATIC, STEPPED
from smarts.types.episode_schema import (
    AGENT_STATES,
    DECISIONS,
    EXTRAS,
    OBSERVATIONS,
    VEHICLES,
)
from smarts.types.events import Outcome

STEPS = 100
"""Number of steps in one message."""
POLICY = "policy"
"""The one fact that recorded episodes do not have."""
MOST_STEPS = 10_000_000
"""Largest number of steps of an episode."""

_NEWEST = DECISIONS.name, EXTRAS.name, OBSERVATIONS.name
"""Tables of agents whose rows hold until the next one of the same name."""
_COLLIDING = VEHICLES.name, AGENT_STATES.name

Columns = Mapping[str, NDArray]


def compact_episode(
    episode: RecordedEpisode, begin: float | None = None, end: float | None = None, *, policy: str = ""
) -> bytes:
    """Return a recorded episode as a compact episode.

    Args:
        episode: The episode.
        begin: First time that is wanted [s]; None: the first.
        end: Last time that is wanted [s]; None: the last.
        policy: Name of what drove the egos, for viewers.

    Raises:
        SmartsError: A table or the map is damaged or missing, or nothing is between these times.
    """
    try:
        return b"".join(framed(messages_of(episode, _steps(episode, begin, end), policy)))
    except (LookupError, ValueError, TypeError, ArithmeticError) as error:
        raise RecordError(
            f"the tables of the recorded episode do not fit together: {error}",
            place=str(episode.folder),
            remedy="bring the folder back from a copy, or record the episode again",
        ) from error


def messages_of(episode: RecordedEpisode, steps: Ints, policy: str = "") -> Iterator[dict[str, Any]]:
    """Yield the messages of some consecutive steps of a recorded episode."""
    graph, facts = episode.roads(), {**episode.facts, POLICY: policy}
    encoder = EpisodeEncoder(map_message(graph, str(facts["map"])), origin_of(graph), facts)
    yield from encoder.opening()
    static = {table.name: episode.table(table.name) for table in STATIC}
    static = {name: columns for name, columns in static.items() if name == "agents" or _rows(columns)}
    yield from encoder.static({**static, "names": episode.table("names")})
    in_order = _in_order(episode)
    for begin in range(0, int(steps[0]), STEPS):
        # Which vehicles have collided is known from the messages that are left out.
        left_out = np.arange(begin, min(begin + STEPS, steps[0]), dtype=np.int32)
        rows = {name: _of(in_order[name], left_out) for name in _COLLIDING if name in in_order}
        encoder.chunk(left_out, rows, is_live=True)
    encoder = encoder.untold()
    for begin in range(0, len(steps), STEPS):
        of_chunk = steps[begin : begin + STEPS]
        rows = {name: _of(columns, of_chunk) for name, columns in in_order.items()}
        if begin == 0:
            # What lasts until it changes is needed from before the first step, too.
            until = np.arange(of_chunk[-1] + 1, dtype=np.int32)
            rows |= {name: _of(in_order[name], until) for name in LASTING if name in in_order}
            rows |= {name: _with_newest(in_order[name], of_chunk) for name in _NEWEST if name in in_order}
        yield from encoder.chunk(of_chunk, rows)
    yield from encoder.end(bool(facts["is_complete"]), str(facts["remark"]))


def _in_order(episode: RecordedEpisode) -> dict[str, Columns]:
    """Return the tables of an episode that have rows for steps, and the vehicles', in the steps' order."""
    tables = {table.name: episode.table(table.name) for table in STEPPED if table is not OUTCOMES}
    tables[OUTCOMES.name] = _outcomes(episode.table("agents"))
    tables["vehicles"] = episode.table("vehicles")
    return {
        name: _by_step(columns) for name, columns in tables.items() if _rows(columns) or name == "vehicles"
    }


def _steps(episode: RecordedEpisode, begin: float | None, end: float | None) -> Ints:
    """Return the steps between two times."""
    dt, last = float(episode.facts["dt"]), int(episode.facts["steps"])
    if not (dt > 0 and 0 <= last <= MOST_STEPS):
        raise ValueError(f"{last} steps of {dt} s")
    # Without the rounding of a division, as of 0.3 by 0.1.
    first = 0 if begin is None else max(0, math.ceil(round(begin / dt, 6)))
    behind = last if end is None else min(last, math.floor(round(end / dt, 6)))
    if first > behind:
        raise SmartsError(
            f"nothing lies between {begin or 0:g} s and {last * dt if end is None else end:g} s",
            place=str(episode.folder),
            remedy=f"the episode goes from 0 to {last * dt:g} s",
        )
    return np.arange(first, behind + 1, dtype=np.int32)


def _outcomes(agents: Columns) -> dict[str, NDArray]:
    """Return how agents ended, from the table `agents`."""
    rows = np.flatnonzero((agents["outcome"] != Outcome.NONE) & (agents["end_step"] >= 0))
    columns = {"step": agents["end_step"][rows], "agent": rows}
    return columns | {name: agents[name][rows] for name in ("outcome", "partner_slot", "partner_generation")}


def _rows(columns: Columns) -> int:
    return len(next(iter(columns.values())))


def _by_step(columns: Columns) -> Columns:
    order = np.argsort(columns["step"], kind="stable")
    return {name: column[order] for name, column in columns.items()}


def _of(columns: Columns, steps: Ints) -> Columns:
    """Return the rows of consecutive steps."""
    rows = slice(*np.searchsorted(columns["step"], [steps[0], steps[-1] + 1]).tolist())
    return {name: column[rows] for name, column in columns.items()}


def _with_newest(columns: Columns, steps: Ints) -> Columns:
    """Return the rows of consecutive steps, and before them the newest one of each agent and name."""
    first, behind = np.searchsorted(columns["step"], [steps[0], steps[-1] + 1]).tolist()
    keys = [columns[name][:first].tolist() for name in ("agent_id", "name") if name in columns]
    newest = {key: row for row, key in enumerate(zip(*keys, strict=True))}
    rows = np.array(sorted([*newest.values(), *range(first, behind)]), np.int64)
    return {name: column[rows] for name, column in columns.items()}
