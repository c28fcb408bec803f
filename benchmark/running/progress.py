"""Progress messages of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

WAITING, STARTING = "waiting", "starting"
"""States of a job without progress: not yet given to Ray, and given to Ray."""


@dataclass(frozen=True)
class RunProgress:
    """How far a run is."""

    phase: str
    """TRAINING, TESTING or FINISHED."""
    share: float = 0.0
    """Of the budget, or of the test."""
    iteration: int = 0
    agent_steps: int = 0
    """Simulation steps of 0.1 s, once for each agent."""
    seconds: float = 0.0
    """Of training, earlier parts of the run included."""
    agent_steps_per_second: float = 0.0
    returns: float = float("nan")
    """Mean of the last episodes and agents."""
    completion: float = float("nan")
    collision: float = float("nan")
    validation: Mapping[str, float] | None = None
    """Return, completion and collision of a validation after the iteration, if there was one."""
