"""Recorded episodes as compact episodes: what a browser plays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Ints
from smarts.errors import RecordError
from smarts.sim.episode_files import RecordedEpisode
from smarts.stream.container import framed
from smarts.stream.encoder import EpisodeEncoder
from smarts.stream.road_map import map_message, origin_of
from smarts.stream.tables import OUTCOMES, STATIC, STEPPED
from smarts.types.events import Outcome

STEPS = 100
"""Number of steps in one message."""
POLICY = "policy"
"""The one fact that recorded episodes do not have."""

Columns = Mapping[str, NDArray]


def compact_episode(episode: RecordedEpisode, *, policy: str = "") -> bytes:
    """Return a recorded episode as a compact episode.

    Args:
        episode: The episode.
        policy: Name of what drove the egos, for viewers.

    Raises:
        RecordError: A table or the map is damaged or missing.
    """
    try:
        return b"".join(framed(messages_of(episode, int(episode.facts["steps"]), policy)))
    except (LookupError, ValueError, TypeError, ArithmeticError) as error:
        raise RecordError(
            f"the tables of the recorded episode do not fit together: {error}",
            place=str(episode.folder),
            remedy="bring the folder back from a copy, or record the episode again",
        ) from error


def messages_of(episode: RecordedEpisode, last: int, policy: str = "") -> Iterator[dict[str, Any]]:
    """Yield the messages of a recorded episode up to a step."""
    graph, facts = episode.roads(), {**episode.facts, POLICY: policy}
    encoder = EpisodeEncoder(map_message(graph, str(facts["map"])), origin_of(graph), facts)
    yield from encoder.opening()
    static = {table.name: episode.table(table.name) for table in STATIC}
    static = {name: columns for name, columns in static.items() if name == "agents" or _rows(columns)}
    yield from encoder.static({**static, "names": episode.table("names")})
    in_order = _in_order(episode)
    for begin in range(0, last + 1, STEPS):
        steps = np.arange(begin, min(begin + STEPS, last + 1), dtype=np.int32)
        yield from encoder.chunk(steps, {name: _of(columns, steps) for name, columns in in_order.items()})
    yield from encoder.end(bool(facts["is_complete"]), str(facts["remark"]))


def _in_order(episode: RecordedEpisode) -> dict[str, Columns]:
    """Return the tables of an episode that have rows for steps, and the vehicles', in the steps' order."""
    tables = {table.name: episode.table(table.name) for table in STEPPED if table is not OUTCOMES}
    tables[OUTCOMES.name] = _outcomes(episode.table("agents"))
    tables["vehicles"] = episode.table("vehicles")
    return {
        name: _by_step(columns) for name, columns in tables.items() if _rows(columns) or name == "vehicles"
    }


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
