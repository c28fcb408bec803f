"""Reading recorded traffic of any format: readers by name, and what formats leave out.

A reader is a function `read(source: Source) -> Tracks`. What is missing in a file, or is no number, is the
KeyError or ValueError that Python raises; `read` here makes a sentence of it. Lengths, widths, headings and
speeds that its format does not have are NaN, times may begin anywhere; `read` here completes them.
"""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from xml.etree.ElementTree import ParseError, iterparse

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.frames import FARTHEST, wrap_angle
from smarts.recordings.headings import HeadingRule, infer_headings
from smarts.recordings.tracks import RecordingError, Track, Tracks
from smarts.registry import Registry
from smarts.types.vehicles import VehicleKind

READERS = Registry(
    "format of recordings",
    {
        "CommonRoad": "smarts.recordings.readers.commonroad:read",
        "SHF": "smarts.recordings.readers.shf:read",
        "NGSIM": "smarts.recordings.readers.ngsim:read",
        "FCD": "smarts.recordings.readers.sumo_fcd:read",
        "SMARTS": "smarts.recordings.readers.episode:read",
        "INTERACTION": "smarts.recordings.readers.interaction:read",
        "Argoverse": "smarts.recordings.readers.argoverse:read",
        "Waymo": "smarts.recordings.readers.waymo:read",
    },
)
_BY_ENDING = {".shf": "SHF", ".txt": "NGSIM", ".parquet": "Argoverse"}
_BY_ROOT = {"commonRoad": "CommonRoad", "fcd-export": "FCD"}
"""Outermost element of an XML file -> format."""
SIZES = {
    VehicleKind.PASSENGER: (5.0, 1.8),
    VehicleKind.BUS: (12.0, 2.5),
    VehicleKind.COACH: (14.0, 2.6),
    VehicleKind.TRUCK: (7.1, 2.4),
    VehicleKind.TRAILER: (16.5, 2.55),
    VehicleKind.MOTORCYCLE: (2.2, 0.9),
    VehicleKind.BICYCLE: (1.6, 0.65),
    VehicleKind.PEDESTRIAN: (0.215, 0.478),
}
"""Length and width of a vehicle whose size was not recorded, by kind [m]: SUMO's defaults."""


@dataclass(frozen=True)
class Source:
    """A recording on disk."""

    path: Path
    """Its file, FILE#ID of a scenario of Waymo or a location of NGSIM's CSV, or the folder of an episode."""
    headings: HeadingRule = field(default_factory=HeadingRule)
    """How headings follow from positions, in formats without headings."""


def read(source: Source, format: str | None = None) -> Tracks:
    """Return a recording, its times from its first sample on.

    Args:
        source: What to read.
        format: A name in `READERS`; None: recognised by the file.

    Raises:
        RecordingError: It is of no known format, or not as its format says.
        UnknownNameError: There is no such format.
    """
    format = format or guess_format(source.path)
    try:
        tracks = READERS[format](source)
    except (OSError, ParseError, sqlite3.Error, KeyError, ValueError) as error:
        text = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        problem = f"it is not as recordings of the format {format} are: {text}"
        raise RecordingError(problem, place=str(source.path), remedy="give the unchanged file") from error
    steps = np.diff(tracks.t)[tracks.track[1:] == tracks.track[:-1]]
    if problem := _problem(tracks, steps):
        raise RecordingError(problem, place=str(source.path), remedy="leave out such rows")
    # Files round times, and so single steps; steps over gaps are other ones.
    usual = np.abs(steps / np.median(steps) - 1) < 0.5
    facts = {
        "name": source.path.name.partition(".")[0],
        "source": source.path.name,
        "source_format": format,
        "time_step": f"{steps[usual].mean():.9g}",
        "duration": f"{round(float(np.ptp(tracks.t)), 4):g}",
    }
    return _completed(tracks, facts | {**tracks.facts}, source.headings)


def _problem(tracks: Tracks, steps: Floats) -> str:
    """Return what is wrong with what a reader returned, "" if nothing is."""
    if not (np.isfinite(tracks.t) & (np.maximum(np.abs(tracks.x), np.abs(tracks.y)) < FARTHEST)).all():
        return f"it has times or positions that are no numbers, or beyond {FARTHEST:.0e}"
    if not len(steps):
        return "it has no vehicle with two samples or more"
    return "it has two samples of one vehicle at one time" if (steps <= 0).any() else ""


def guess_format(path: Path) -> str:
    """Return the name of a recording's format.

    Raises:
        RecordingError: It has none of the known ones, or is not there.
    """
    file = path.with_name(path.name.partition("#")[0])
    if not path.exists() and not file.exists():
        raise RecordingError("there is no such file or folder", place=str(path))
    found = "SMARTS" if (path / "vehicles.parquet").is_file() else _BY_ENDING.get(path.suffix.lower(), "")
    found = "Waymo" if ".tfrecord" in file.name else found
    found = "Argoverse" if any(path.glob("scenario_*.parquet")) else found
    if file.suffix == ".csv":
        with file.open() as lines:
            found = "NGSIM" if "Vehicle_ID" in next(lines, "") else "INTERACTION"
    if path.suffix == ".xml":
        with suppress(ParseError):
            _, root = next(iter(iterparse(path, ("start",))))
            found = _BY_ROOT.get(root.tag, "")
    if not found:
        remedy = f"give one of {', '.join(READERS)}; --format names the format where the file does not"
        raise RecordingError("it is no recording of a known format", place=str(path), remedy=remedy)
    return found


def tracks_of_rows(
    names: Sequence[str],
    users: Mapping[str, tuple[int, float, float]],
    samples: Floats,
    facts: Mapping[str, str],
) -> Tracks:
    """Return the tracks of a table of samples.

    Args:
        names: The vehicle of each row, shape (N,).
        users: Kind, length and width [m] of each vehicle that is to become a track.
        samples: Columns t, x, y, heading, speed, shape (N, 5); in any order of rows.
        facts: What is known of the recording.
    """
    number = {name: each for each, name in enumerate(users)}
    of = np.array([number.get(name, -1) for name in names])
    order = np.lexsort((samples[:, 0], of))
    parts = np.split(order, np.searchsorted(of[order], np.arange(len(users))))[1:]
    found = ((name, rows) for name, rows in zip(users, parts, strict=True) if len(rows))
    return Tracks.of((Track(str(name), *users[name], samples[rows]) for name, rows in found), facts)


def left_out(kinds: Iterable[str]) -> dict[str, str]:
    """Return the fact on what becomes no tracks, as left_out = "pedestrian (3), train (1)"."""
    text = ", ".join(f"{kind} ({count})" for kind, count in Counter(kinds).items())
    return {"left_out": text} if text else {}


def _completed(tracks: Tracks, facts: dict[str, str], rule: HeadingRule) -> Tracks:
    """Fill in sizes, headings and speeds that are NaN; say so in the facts."""
    sizes = np.array([SIZES[VehicleKind(kind)] for kind in tracks.kind])
    known = (tracks.length > 0) & (tracks.width > 0)
    heading, speed = tracks.heading.copy(), tracks.speed.copy()
    for rows in (slice(*ends) for ends in pairwise(tracks.start)):
        t, x, y = tracks.t[rows], tracks.x[rows], tracks.y[rows]
        if np.isnan(heading[rows]).any():
            heading[rows] = infer_headings(t, x, y, rule)
        if np.isnan(speed[rows]).any():
            speed[rows] = np.hypot(np.gradient(x, t), np.gradient(y, t)) if len(t) > 1 else 0.0
    assumed = [
        *filter(None, [facts.get("assumed")]),
        *[f"{(~known).sum()} of {len(tracks)} vehicles have sizes usual for their kinds"] * (not known.all()),
        *["headings follow from positions"] * bool(np.isnan(tracks.heading).any()),
        *["speeds follow from positions"] * bool(np.isnan(tracks.speed).any()),
    ]
    return replace(
        tracks,
        t=tracks.t - tracks.t.min(),
        signals=tracks.signals - np.eye(1, 6) * tracks.t.min(),
        length=np.where(known, tracks.length, sizes[:, 0]),
        width=np.where(known, tracks.width, sizes[:, 1]),
        heading=wrap_angle(heading),
        speed=speed,
        facts=facts | ({"assumed": "; ".join(assumed)} if assumed else {}),
    )
