"""The table of results: a row for each agent-episode, measured from recorded episodes."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.generalization import SPLITS
from benchmark.metrics.measure import Columns, Measure
from benchmark.metrics.registry import ALWAYS, METRICS
from smarts.errors import MapError, OwnCodeError, RecordError, SmartsError
from smarts.registry import is_own_name
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.types.events import Outcome

FORMAT = 2
"""Format of the file; others are refused."""
COUNTS = "episodes"
"""Key of `DataFrame.attrs`: how many episodes were measured, invalid, incomplete, and which are corrupted."""

EPISODE_KEYS = ("scenario", "variation", "traffic", "seed", "world", "episode")
"""Columns that identify an episode. Equal keys mean equal start and traffic, if the scenario and the number
of agents are unchanged; `START` verifies it."""
START = ("start_x", "start_y", "start_heading", "start_speed")
"""Columns of each agent's start [m, m, rad, m/s]."""

_VERSION = b"smarts_bench.metrics.format"
_COUNTS = b"smarts_bench.metrics.episodes"


def measure_episodes(
    folder: str | Path,
    *,
    labels: Mapping[str, Any] = {},
    split: str = "train",
    metrics: Sequence[str] = (),
    indices: range | None = None,
) -> pd.DataFrame:
    """Measure all whole episodes of a store.

    Args:
        folder: Of the store; not one episode's.
        labels: Further columns, the same in all rows: algorithm, training_seed, mode ...
        split: "train" or "held_out": see generalization.
        metrics: Names, by default all that are registered; the two of `ALWAYS` are measured in any case.
        indices: Indices of the episodes to measure (column `world`); by default all.

    Returns:
        A row for each agent of each episode: the labels, `split`, `EPISODE_KEYS`, agent, outcome, is_invalid,
        the start, and the columns of the metrics; NaN for invalid episodes and for agents that never entered
        (`agents` is 0). Incomplete and unreadable episodes are left out; `attrs["episodes"]` counts both, and
        names the unreadable ones with the reason.

    Raises:
        RecordError: The folder is not there, or the split is unknown.
        UnknownNameError: A metric is unknown.
        OwnCodeError: A user's metric raises, lacks a column, or writes a column of another metric.
    """
    folder = Path(folder)
    _check_source(folder, split)
    chosen = metrics or itertools.filterfalse(is_own_name, METRICS)
    measures = [METRICS[name] for name in dict.fromkeys((*ALWAYS, *chosen))]
    counts: dict[str, Any] = {"measured": 0, "invalid": 0, "incomplete": 0, "corrupted": {}}
    parts = []
    for path in episodes_in(folder):
        try:
            recorded = RecordedEpisode(path)
            if indices is not None and int(recorded.facts["world"]) not in indices:
                continue
            kind, rows = _measured(EpisodeData(recorded, split), measures, labels)
        except (RecordError, MapError) as error:
            counts["corrupted"][path.name] = error.problem
        except (IndexError, KeyError, ValueError) as error:
            # Half a file, or numbers that do not fit together; the other episodes are whole.
            counts["corrupted"][path.name] = f"not a whole episode: {type(error).__name__}: {error}"
        else:
            counts[kind] += 1
            parts += rows
    table = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
    table.attrs[COUNTS] = counts
    return table


def _check_source(folder: Path, split: str) -> None:
    if split not in SPLITS:
        raise RecordError(f"there is no split '{split}'", remedy=f"choose one of {', '.join(SPLITS)}")
    if not folder.is_dir():
        raise RecordError("there is no such folder of episodes", place=str(folder))


def _measured(
    episode: EpisodeData, measures: Iterable[Measure], labels: Mapping[str, Any]
) -> tuple[str, list[pd.DataFrame]]:
    """Return "measured", "invalid" or "incomplete" (cut short), and the rows, if any."""
    is_invalid = episode.facts["is_invalid"]
    if not is_invalid and not episode.facts["is_complete"]:
        return "incomplete", []
    return "invalid" if is_invalid else "measured", [_rows(episode, measures, labels)]


def _rows(episode: EpisodeData, measures: Iterable[Measure], labels: Mapping[str, Any]) -> pd.DataFrame:
    facts, agents = episode.facts, episode.agents
    scenario, _, variation = str(facts["scenario"]).partition("@")
    is_invalid = bool(facts["is_invalid"])
    took_part = episode.entered & (not is_invalid)
    columns: dict[str, Any] = {
        **labels,
        "split": episode.split,
        "scenario": scenario,
        "variation": variation,
        "traffic": str(facts["traffic"]),
        **{name: int(facts[name]) for name in ("seed", "world", "episode")},
        "agent": agents["name"],
        "outcome": [Outcome(int(outcome)).name.lower() for outcome in agents["outcome"]],
        "is_invalid": is_invalid,
        **{name: agents[name] for name in START},
        "duration": episode.duration,
        "distance_travelled": agents["distance_travelled"],
        "agents": took_part.astype(float),
    }
    for measure in measures:
        found = None if is_invalid else measure.measure(episode)
        for name in measure.columns:
            written = np.nan if found is None else _column(measure, found, name, took_part)
            if name in columns and not np.array_equal(columns[name], written, equal_nan=True):
                raise OwnCodeError(
                    f"the metric {measure.name!r} writes another {name!r} than what has that name already",
                    place=measure.name,
                    remedy="give its column a name of its own",
                )
            columns[name] = written
    return pd.DataFrame(columns, index=pd.RangeIndex(episode.count))


def _column(measure: Measure, found: Columns, name: str, took_part: NDArray[np.bool_]) -> NDArray:
    """Return a column of an episode, NaN for agents that took no part."""
    try:
        values = np.broadcast_to(np.asarray(found[name], float), took_part.shape)
    except (KeyError, TypeError, ValueError) as error:
        raise OwnCodeError(
            f"the metric {measure.name!r} gives no column {name!r} of a number for each agent",
            place=measure.name,
            remedy="return all of its `columns`, each of shape (A,)",
        ) from error
    return np.where(took_part, values, np.nan)


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table to a Parquet file, which is whole or not there at all.

    Raises:
        RecordError: It cannot be written.
    """
    arrow = pa.Table.from_pandas(table, preserve_index=False)
    counts = json.dumps(table.attrs.get(COUNTS, {})).encode()
    arrow = arrow.replace_schema_metadata(
        {**(arrow.schema.metadata or {}), _VERSION: str(FORMAT).encode(), _COUNTS: counts}
    )
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with partial.open("wb") as file:
                pq.write_table(arrow, file, compression="zstd")
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise RecordError(
            f"cannot write the table of results: {error}", place=str(path), remedy="name another place"
        ) from error


def read_table(path: Path) -> pd.DataFrame:
    """Read what `write_table` wrote.

    Raises:
        RecordError: It is missing, damaged, or of another format.
    """
    try:
        arrow = pq.read_table(path)
        metadata = arrow.schema.metadata or {}
        found = metadata.get(_VERSION, b"").decode()
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise RecordError(
            f"not a table of results: {error}", place=str(path), remedy="measure the episodes again"
        ) from error
    if found != str(FORMAT):
        raise RecordError(
            f"written in format {found or 'unknown'}, this program reads format {FORMAT}",
            place=str(path),
            remedy="read it with the program that wrote it",
        )
    table = arrow.to_pandas()
    table.attrs[COUNTS] = _counts_of(metadata.get(_COUNTS, b""), path)
    return table


def _counts_of(text: bytes, path: Path) -> dict[str, Any]:
    try:
        found = json.loads(text)
        numbers = {name: int(found[name]) for name in ("measured", "invalid", "incomplete")}
        return {**numbers, "corrupted": dict(found["corrupted"])}
    except (ValueError, KeyError, TypeError) as error:
        raise RecordError(
            "does not say how many episodes were measured",
            place=str(path),
            remedy="measure the episodes again",
        ) from error


def sums_of(rows: Any, columns: Sequence[str], by: Sequence[pd.Series]) -> Any:
    """Return the sums of columns over groups of agent-episodes.

    Args:
        rows: Of a table of results.
        columns: Names.
        by: The groups' keys.

    Returns:
        A row for each group. NaN, not 0, where an agent that took part has no number: a table of another
        version may lack a column.
    """
    values = rows.reindex(columns=[*columns]).where(rows["agents"] > 0, 0.0)
    grouped = values.groupby([*by], dropna=False, sort=True)
    return grouped.sum().where(grouped.count().eq(grouped.size(), axis=0))


def join_tables(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Return the rows of several tables, with their counts added up.

    Raises:
        SmartsError: There are none.
    """
    if not tables:
        raise SmartsError("there is no table of results to join")
    joined = pd.concat([table.reset_index(drop=True) for table in tables], ignore_index=True)
    counts: dict[str, Any] = {"measured": 0, "invalid": 0, "incomplete": 0, "corrupted": {}}
    for table in tables:
        for name, value in table.attrs.get(COUNTS, {}).items():
            counts[name] = {**counts[name], **value} if isinstance(value, dict) else counts[name] + value
    joined.attrs[COUNTS] = counts
    return joined
