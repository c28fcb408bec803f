"""What the process of a run tells the driver, which alone writes results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

WAITING, STARTING = "waiting", "starting"
"""States of a job without progress: not yet given to Ray, and given to Ray."""
BACKLOG = 8
"""Messages that a run sends ahead of what the driver has taken; then it waits."""


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


@dataclass(frozen=True)
class RunProgress:
    """How far a run is."""

    phase: str
    """TRAINING, TESTING or FINISHED."""
    share: float = 0.0
    """Share of the budget, or of the test, that is done."""
    line: Mapping[str, Any] = field(default_factory=dict)
    """Columns of progress.csv after an iteration of training."""
    validation: Mapping[str, float] | None = None
    """Return, completion and collision of a validation after the iteration, if there was one."""


Message = Began | Noted | Line | Kept | RunProgress
