"""The input of traffic engines, and the states of signals."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from smarts.registry import Registry
from smarts.types.recorded import RecordedTraffic

DEFAULT_ENGINE = "SUMO"
"""The engine of scenarios that name none."""


def _adopt(name: str, found: Any) -> Any:
    """Return a user's traffic engine: a class with the methods of `traffic_engine.TrafficEngine`."""
    methods = ("reset", "step", "can_accept", "close")
    missing = [each for each in methods if not callable(getattr(found, each, None))]
    if not isinstance(found, type) or missing:
        raise ValueError(f"is not a class with the methods {', '.join(methods)}: {missing} missing")
    return found


TRAFFIC_ENGINES = Registry(
    "traffic engine",
    {
        "SUMO": "smarts.providers.sumo_engine:SumoEngine",
        "Native": "smarts.providers.native.engine:Native",
        "Recorded": "smarts.providers.recorded.engine:Recorded",
    },
    _adopt,
)
"""`Traffic.engine` of the scenario language -> "module:Class" of a `traffic_engine.TrafficEngine`;
`Options.traffic_engine` takes a user's own as "module:Class"."""


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
    options: tuple[tuple[str, str], ...] = ()
    """Further options of SUMO, such as "begin", from which `warm_up` counts [s]."""
    reaction_time: float | None = 0.0
    """The longest of any of its drivers [s]; 0: all decide in every step; None: unknown, as of own files."""
    recording: RecordedTraffic | None = None
    """What the engine Recorded drives; the other engines drive the files."""


class Signal(enum.IntEnum):
    """The light that a lane into a junction shows."""

    NONE = 0
    STOP = 1
    CAUTION = 2
    GO = 3
