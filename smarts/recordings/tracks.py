"""The tracks of a recording as arrays, and their files in a folder.

Every format becomes `tracks.parquet`, a row for each sample, track by track, and `signals.parquet` where it
has traffic lights, a row for each change.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.errors import SmartsError
from smarts.recordings.signals import NO_SIGNALS, read_signals, write_signals
from smarts.whole_files import written_whole

FORMAT = "smarts-recording 1"
TRACKS = "tracks.parquet"
SAMPLE = ("t", "x", "y", "heading", "speed")
"""Columns of samples: time since the recording's first sample [s], centre of the footprint in the map frame
[m, m], heading [rad], speed along it [m/s]."""
GAP = 3.5
"""Tracks are split where their samples are farther apart [time steps]."""
_COLUMNS = {"track": pa.string(), "kind": pa.int8()}
_COLUMNS |= dict.fromkeys(("length", "width", *SAMPLE), pa.float64())


class RecordingError(SmartsError):
    """A recording that cannot be read, or that is not what it should be."""


class Track(NamedTuple):
    """The track of one vehicle."""

    name: str
    """The source's id."""
    kind: int
    """A `VehicleKind`."""
    length: float
    """Length of the footprint [m]."""
    width: float
    """Width of the footprint [m]."""
    samples: Floats
    """Columns as in `SAMPLE`, in order of time, shape (n, 5)."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """T tracks in order of their first time, with N samples, track by track."""

    names: tuple[str, ...]
    """The source's ids."""
    kind: Bytes
    """A `VehicleKind` each, shape (T,)."""
    length: Floats
    """Length of each footprint [m], shape (T,)."""
    width: Floats
    """Width of each footprint [m], shape (T,)."""
    start: Ints
    """First sample of each track, and N, shape (T + 1,)."""
    t: Floats
    """Time since the recording's first sample [s], rising in a track, shape (N,) as are the following."""
    x: Floats
    """Centre of the footprint in the map frame [m]."""
    y: Floats
    """[m]"""
    heading: Floats
    """Counter-clockwise from +x, in (-pi, pi] [rad]."""
    speed: Floats
    """Along the heading [m/s]."""
    facts: Mapping[str, str] = field(default_factory=dict)
    """Where the recording comes from: name, source, source_format, licence, attribution, time_step
    and duration [s], is_traffic ("true" or "false"); what is assumed and left_out."""
    signals: Floats = field(default_factory=NO_SIGNALS.copy)
    """What traffic lights showed: columns as in `signals.SIGNAL`, shape (N, 6)."""

    @classmethod
    def of(
        cls, tracks: Iterable[Track], facts: Mapping[str, str] | None = None, signals: Floats = NO_SIGNALS
    ) -> Tracks:
        """Return tracks as arrays, in order of their first time; each has one sample or more."""
        ordered = sorted(tracks, key=lambda track: track.samples[0, 0])
        samples = np.concatenate([np.zeros((0, 5)), *(track.samples for track in ordered)])
        return cls(
            names=tuple(track.name for track in ordered),
            kind=np.array([track.kind for track in ordered], np.int8),
            length=np.array([track.length for track in ordered], float),
            width=np.array([track.width for track in ordered], float),
            start=np.cumsum([0, *(len(track.samples) for track in ordered)], dtype=np.int32),
            facts=dict(facts or {}),
            signals=signals,
            **dict(zip(SAMPLE, np.ascontiguousarray(samples.T), strict=True)),
        )

    def apart(self) -> list[Track]:
        """Return the tracks one by one."""
        samples = np.column_stack([getattr(self, name) for name in SAMPLE])
        parts = np.split(samples, self.start[1:-1])
        columns = (self.names, self.kind.tolist(), self.length, self.width, parts)
        return [Track(*each) for each in zip(*columns, strict=True)]

    def of_samples(self, keeps: Bools) -> Tracks:
        """Return the tracks with some of their samples, a mask of shape (N,); those without any are gone.

        Behind a gap of more than `GAP` of its usual time steps, a track is another one: NAME, NAME~2, ...
        """
        found = []
        for track, mask in zip(self.apart(), np.split(keeps, self.start[1:-1]), strict=True):
            kept, steps = track.samples[mask], np.diff(track.samples[:, 0])
            usual = np.median(steps) if len(steps) else 0.0
            parts = np.split(kept, np.flatnonzero(np.diff(kept[:, 0]) > GAP * usual) + 1)
            names = track.name, *(f"{track.name}~{number}" for number in range(2, len(parts) + 1))
            own = zip(names, parts, strict=True)
            found += [track._replace(name=name, samples=part) for name, part in own if len(part)]
        return Tracks.of(found, self.facts, self.signals)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def track(self) -> Ints:
        """The track of each sample, shape (N,)."""
        return np.repeat(np.arange(len(self), dtype=np.int32), np.diff(self.start))


def write_tracks(tracks: Tracks, folder: Path) -> None:
    """Write a recording's files into a folder.

    Raises:
        SmartsError: It cannot be written.
    """
    of = tracks.track
    names = pa.DictionaryArray.from_arrays(pa.array(of), pa.array(tracks.names, pa.string()))
    columns = {"track": names} | {name: getattr(tracks, name)[of] for name in ("kind", "length", "width")}
    columns |= {name: getattr(tracks, name) for name in SAMPLE}
    made = [pa.array(columns[name]) for name in _COLUMNS]
    table = pa.table(made, [*_COLUMNS]).replace_schema_metadata({"format": FORMAT, **tracks.facts})
    with written_whole(folder / TRACKS) as partial:
        pq.write_table(table, partial)
    write_signals(tracks.signals, folder)


def read_tracks(folder: Path) -> Tracks:
    """Return the recording in a folder that `smarts-bench data import` wrote.

    Raises:
        RecordingError: There is none, or it is of another version.
    """
    columns, facts = _read(folder / TRACKS)
    track = columns["track"]
    first = np.flatnonzero(np.append(True, track[1:] != track[:-1])) if len(track) else np.zeros(0, int)
    return Tracks(
        names=tuple(track[first].tolist()),
        kind=columns["kind"][first],
        length=columns["length"][first],
        width=columns["width"][first],
        start=np.append(first, len(track)).astype(np.int32),
        facts=facts,
        signals=read_signals(folder),
        **{name: columns[name] for name in SAMPLE},
    )


def _read(file: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the columns and the metadata of a file."""
    again = "import the recording again: smarts-bench data import SOURCE --out FOLDER --licence TEXT"
    try:
        table = pq.read_table(file)
    except (OSError, pa.ArrowException) as error:
        problem = f"cannot be read: {error}" if file.exists() else "there is no recording"
        raise RecordingError(problem, place=str(file), remedy=again) from error
    found = table.schema.metadata or {}
    facts = {key.decode(): value.decode() for key, value in found.items() if not key.startswith(b"ARROW")}
    if (format := facts.pop("format", None)) != FORMAT:
        problem = f"is of the format {format!r}, not {FORMAT!r}"
        raise RecordingError(problem, place=str(file), remedy=again)
    return {name: table[name].cast(kind).to_numpy() for name, kind in _COLUMNS.items()}, facts
