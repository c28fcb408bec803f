"""Loggers: each reads the lines that progress.csv gets, for one tool."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

COUNTS = ("iteration", "agent_steps")
"""Columns that say when; the others are drawn over the agent-steps."""


@dataclass(frozen=True)
class Logged:
    """A training, as loggers show it."""

    experiment: str
    name: str
    """Algorithm, task, traffic and seed."""
    id: str
    """The same when it continues, and another for each training."""
    folder: Path
    """Folder of its results."""
    config: Mapping[str, Any]
    """Content of config.yaml."""


def numbers_of(line: Mapping[Any, Any]) -> Iterator[tuple[str, float]]:
    """Yield name and value of what is a number in a line."""
    for name, value in line.items():
        if name not in COUNTS and value != "" and math.isfinite(float(value)):
            yield name, float(value)
