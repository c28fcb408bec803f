"""What the process of a run tells the driver, which alone writes results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from benchmark.running.progress import RunProgress

BACKLOG = 8
"""Messages that a run sends ahead of what the driver has taken; then it waits."""


@dataclass(frozen=True)
class Start:
    """What the process of a run gets beside its job."""

    folder: str
    """The run's folder on the driver's machine, for messages."""
    checkpoint: Mapping[str, bytes]
    """Files of the last checkpoint; empty without one."""


@dataclass(frozen=True)
class Began:
    """A training has begun or continues."""

    circumstances: Mapping[str, Any]
    """Versions, machine and time."""
    scenarios: Mapping[str, str]
    """Name -> digest of each scenario, as built where the run is."""


@dataclass(frozen=True)
class Noted:
    """Values for run.json."""

    values: Mapping[str, Any]


@dataclass(frozen=True)
class Line:
    """A line of progress.csv."""

    columns: Mapping[str, Any]


@dataclass(frozen=True)
class Kept:
    """A file or a folder of the results; see `RunFolder.keep`."""

    place: str
    content: Mapping[str, bytes] | bytes


Message = Began | Noted | Line | Kept | RunProgress
