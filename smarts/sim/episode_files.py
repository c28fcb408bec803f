"""Recorded episodes on disk: a folder of Parquet files each, whole or not there at all.

An episode is written into a hidden folder of its store's process, out of which it is moved when all is in it.
The process holds a lock on a file in that folder; what a killed one leaves is removed by the next one that
opens the store.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import weakref
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from smarts.errors import MapError, RecordError
from smarts.locked_folders import make_locked, remove_left
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode_schema import (
    EPISODE,
    INTEGERS,
    NUMBERS,
    TABLE,
    TEXT,
    VEHICLES,
    VERSION,
    Table,
)

MAPS = "maps"
PARTIAL = ".partial-recording-"
"""Begins the name of the folder of what a process is writing."""

Rows = Mapping[str, Sequence[Any] | NDArray]
"""Columns by name, all of one length."""


@contextmanager
def _writing(root: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, pa.ArrowException) as error:
        raise RecordError(
            f"episodes cannot be written: {error}",
            place=str(root),
            remedy="name a folder that can be written to, on a disk that is not full",
        ) from error


class EpisodeStore:
    """A folder of recorded episodes, open for writing.

    Several processes may write into one store.

    Args:
        root: The folder; made if it is not there.

    Raises:
        RecordError: It cannot be written to.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._maps: dict[int, tuple[LaneGraph, str]] = {}
        self._end: weakref.finalize | None = None
        self._partial = root
        with _writing(root):
            (root / MAPS).mkdir(parents=True, exist_ok=True)
            remove_left(root, PARTIAL)

    def begin(self, name: str) -> EpisodeWriter:
        """Return a writer of a new episode; whole, it gets the name, with a number if that is taken."""
        return EpisodeWriter(self, name)

    def partial(self) -> Path:
        """Return the folder for what is being written; made and locked by the first call."""
        if self._end is None or not self._end.alive:
            self._partial, lock = make_locked(self.root, PARTIAL)
            self._end = weakref.finalize(self, _remove_own, self._partial, lock, os.getpid())
            # At the end of the process recorders write what is left first, and close their stores.
            self._end.atexit = False
        return self._partial

    def close(self) -> None:
        """Remove what was not finished."""
        if self._end is not None:
            self._end()

    def map(self, graph: LaneGraph) -> str:
        """Return the digest of a map, which is in the store from now on."""
        known = self._maps.get(id(graph))
        if known is not None:
            return known[1]
        partial = self.partial() / f"map-{id(graph):x}"
        with _writing(self.root):
            graph.save(partial)
            digest = hashlib.blake2b(partial.read_bytes(), digest_size=10).hexdigest()
            partial.replace(self.root / MAPS / f"{digest}.npz")
        # The graph itself is kept, so that its id stays its own.
        self._maps[id(graph)] = graph, digest
        return digest


class EpisodeWriter:
    """One episode in the making."""

    def __init__(self, store: EpisodeStore, name: str) -> None:
        self._store, self._root = store, store.root
        self._name = name
        self._folder = store.root
        self._open: dict[str, pq.ParquetWriter] = {}

    def append(self, table: str, rows: Rows) -> None:
        """Append rows to a table.

        Raises:
            RecordError: They cannot be written.
        """
        if TABLE[table].is_optional and not len(rows[TABLE[table].names[0]]):
            return
        with _writing(self._root):
            if table not in self._open:
                if not self._open:
                    self._folder = self._store.partial() / f"{id(self):x}"
                    self._folder.mkdir()
                self._open[table] = _parquet_writer(self._folder / f"{table}.parquet", TABLE[table])
            if table == VEHICLES.name:
                # By vehicle, neighbouring rows are alike and take a sixth less; readers order them by step.
                order = np.lexsort([np.asarray(rows[name]) for name in ("step", "generation", "slot")])
                rows = {name: np.asarray(column)[order] for name, column in rows.items()}
            self._open[table].write_table(_arrow_table(TABLE[table], rows))

    def finish(self) -> Path:
        """Make the episode appear under its name; return its folder.

        Raises:
            RecordError: It cannot be written.
        """
        for name, table in TABLE.items():
            if name not in self._open and not table.is_optional:
                self.append(name, {column: [] for column in table.names})
        folder, number = self._root / self._name, 1
        with _writing(self._root):
            for writer in self._open.values():
                writer.close()
            while not self._becomes(folder):
                number += 1
                folder = self._root / f"{self._name}~{number}"
        return folder

    def _becomes(self, folder: Path) -> bool:
        """Give the episode its name; return False if another has it: a folder with files is not replaced."""
        try:
            self._folder.rename(folder)
        except OSError:
            if folder.exists():
                return False
            raise
        return True

    def abandon(self) -> None:
        """Take away what was written."""
        for writer in self._open.values():
            # What cannot be written is not needed any more.
            with contextlib.suppress(OSError, pa.ArrowException):
                writer.close()
        if self._open:
            shutil.rmtree(self._folder, ignore_errors=True)


class RecordedEpisode:
    """One episode on disk; its tables are read when they are asked for.

    Args:
        folder: Folder of the episode.

    Raises:
        RecordError: It is not one, or of another version of this program.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = folder = Path(folder)
        self._tables: dict[str, dict[str, NDArray]] = {}
        if "version" not in self.table(EPISODE.name):
            raise self._damaged(EPISODE.name, "it has no column 'version'")
        found = int(self.facts["version"])
        if found != VERSION:
            raise RecordError(
                f"written in format {found}, this program reads format {VERSION}",
                place=str(folder),
                remedy="record the episode again",
            )

    @cached_property
    def facts(self) -> dict[str, Any]:
        """The row of the table `episode`."""
        columns = self.table(EPISODE.name)
        if any(len(column) != 1 for column in columns.values()):
            raise self._damaged(EPISODE.name, f"{len(columns['version'])} rows instead of one")
        return {name: column[0] for name, column in columns.items()}

    def table(self, name: str) -> Mapping[str, NDArray]:
        """Return the columns of a table; texts and lists of numbers are in arrays of objects."""
        if name not in self._tables:
            read = self._read(name)
            columns = {column: _plain(read[column]) for column in read.column_names}
            if name == VEHICLES.name and (np.diff(columns["step"]) < 0).any():
                order = np.lexsort([columns["slot"], columns["step"]])
                columns = {each: column[order] for each, column in columns.items()}
            self._tables[name] = columns
        return self._tables[name]

    def _read(self, name: str) -> pa.Table:
        try:
            return pq.read_table(self.folder / f"{name}.parquet", page_checksum_verification=True)
        except FileNotFoundError as error:
            if TABLE[name].is_optional:
                return arrow_schema(TABLE[name]).empty_table()
            raise RecordError(
                f"there is no table '{name}' of a recorded episode",
                place=str(self.folder),
                remedy="name the folder of one episode",
            ) from error
        except (OSError, pa.ArrowException) as error:
            raise self._damaged(name, str(error)) from error

    def _damaged(self, table: str, problem: str) -> RecordError:
        return RecordError(
            f"the table '{table}' of the recorded episode is damaged: {problem}",
            place=str(self.folder),
            remedy="bring the folder back from a copy, or record the episode again",
        )

    def check_files(self) -> None:
        """Raise if a table or the map is missing or cut; of each, only the end is read.

        Raises:
            RecordError: A table is missing or cut.
            MapError: The map is.
        """
        for name, table in TABLE.items():
            path = self.folder / f"{name}.parquet"
            if table.is_optional and not path.exists():
                continue
            try:
                pq.read_metadata(path)
            except (OSError, pa.ArrowException) as error:
                raise self._damaged(name, str(error)) from error
        if not zipfile.is_zipfile(self._map):
            raise self._map_error("no lane graph")

    @property
    def _map(self) -> Path:
        return self.folder.parent / MAPS / f"{self.facts['map']}.npz"

    def roads(self) -> LaneGraph:
        """Return the map.

        Raises:
            MapError: It is not beside the episodes, or damaged.
        """
        try:
            return LaneGraph.load(self._map)
        except MapError as error:
            raise self._map_error(error.problem) from error

    def _map_error(self, problem: str) -> MapError:
        path, remedy = self._map, f"bring the file back, since episodes need the folder '{MAPS}' beside them"
        state = "damaged" if path.exists() else "not there"
        return MapError(f"the map of the episode is {state}: {problem}", place=str(path), remedy=remedy)


def episodes_in(root: str | Path) -> list[Path]:
    """Return the folders of all whole episodes of a store, in the order of their names."""
    return sorted(
        folder
        for folder in Path(root).iterdir()
        if not folder.name.startswith(".") and (folder / f"{EPISODE.name}.parquet").exists()
    )


def arrow_schema(table: Table) -> pa.Schema:
    """Return a table's columns as arrow calls them."""
    kinds = {TEXT: pa.string(), NUMBERS: pa.list_(pa.float32()), INTEGERS: pa.list_(pa.int32())}

    def kind_of(kind: str) -> pa.DataType:
        return kinds[kind] if kind in kinds else pa.from_numpy_dtype(np.dtype(kind))

    return pa.schema([(column.name, kind_of(column.kind)) for column in table.columns])


def _parquet_writer(file: Path, table: Table) -> pq.ParquetWriter:
    floats = [column.name for column in table.columns if column.kind.startswith("float")]
    options: dict[str, Any] = {
        "compression": "zstd",
        "use_dictionary": [name for name in table.names if name not in floats] or False,
        # Neighbouring floats share their leading bytes; a dictionary of them would be as large again.
        "column_encoding": dict.fromkeys(floats, "BYTE_STREAM_SPLIT"),
        "write_page_checksum": True,
    }
    return pq.ParquetWriter(file, arrow_schema(table), **options)


def _arrow_table(table: Table, rows: Rows) -> pa.Table:
    schema = arrow_schema(table)
    columns = []
    for column, field in zip(table.columns, schema, strict=True):
        values = rows[column.name]
        if column.kind not in (TEXT, NUMBERS, INTEGERS):
            values = np.asarray(values).astype(column.kind)
        columns.append(pa.array(values, field.type))
    return pa.Table.from_arrays(columns, schema=schema)


def _plain(column: pa.ChunkedArray) -> NDArray:
    if pa.types.is_list(column.type):
        lists = column.combine_chunks()
        numbers = lists.values.to_numpy(zero_copy_only=False)
        plain = np.empty(len(lists), object)
        plain[:] = np.split(numbers, lists.offsets.to_numpy()[1:-1]) if len(lists) else []
        return plain
    return column.to_numpy()


def _remove_own(partial: Path, lock: int, owner: int) -> None:
    # In a process that was forked off, the folder is still its parent's.
    if owner == os.getpid():
        shutil.rmtree(partial, ignore_errors=True)
    os.close(lock)
