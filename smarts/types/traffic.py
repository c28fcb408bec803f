"""What a traffic engine needs to run, and what it says about signals."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class TrafficFiles:
    """One traffic variation of one built scenario, as files."""

    net: Path
    """The compiled SUMO network."""
    routes: tuple[Path, ...] = ()
    """Vehicle types, routes, flows and trips."""
    additional: tuple[Path, ...] = ()
    """Bus stops and the like, loaded before the routes."""
    warm_up: float = 0.0
    """Simulated before an episode begins, so that it starts among traffic [s]."""


class Signal(enum.IntEnum):
    """The light that a lane into a junction shows."""

    NONE = 0
    STOP = 1
    CAUTION = 2
    GO = 3
