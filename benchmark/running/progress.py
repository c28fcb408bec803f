"""What a run tells while it is under way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

WAITING, BEGINNING = "waiting", "beginning"
"""Of a job that tells nothing yet: whether it has been given to Ray."""


@dataclass(frozen=True)
class Progress:
    """Where a run is."""

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
