"""What agents of a simulation that is shown observe, as far as viewers look at it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.sim.observation_notes import observation_notes
from smarts.types.frame import Frame

INTERVAL = 0.05
"""Shortest time from one message with observations to the next [s]: grids take a millisecond each."""


class PublishedSight:
    """The newest observations of some agents of one simulation, which wait for its next frame."""

    def __init__(self) -> None:
        self.agent_ids: list[int] = []
        self._due = 0.0
        self._seen: dict[int, int] = {}
        self._features: dict[tuple[int, str], tuple[int, NDArray]] = {}

    def begin(self) -> None:
        """Begin an episode."""
        self.agent_ids = []
        self._seen, self._features = {}, {}

    def look(self, frame: Frame, row: int, agents: Sequence[int]) -> None:
        """Note which agents observe in a step.

        Args:
            frame: The frame.
            row: Row of the simulation.
            agents: Numbers of those that viewers look at.
        """
        self.agent_ids = np.flatnonzero(np.isin(frame.world.agents.agent[row], agents)).tolist()
        step = int(frame.world.step[row])
        self._seen |= {each: step for each in self.agent_ids if frame.observe_mask[row, each]}

    def annotate(self, name: str, step: int, values: NDArray, agents: Bools) -> None:
        """Take what policies of some agents (N,) get: values of shape (N, ...)."""
        for agent_id in self.agent_ids:
            if agent_id < len(agents) and agents[agent_id]:
                # The caller may reuse its array.
                self._features[agent_id, name] = step, np.ravel(values[agent_id]).astype(np.float32)

    def take(self, frame: Frame, row: int, origin: Floats, now: float) -> list[tuple[Any, ...]]:
        """Return step, agent_id, name and the bytes of float32 of what is new, and forget it."""
        if not (self._seen or self._features) or now < self._due:
            return []
        self._due = now + INTERVAL
        kept = {each: step for each, step in self._seen.items() if each in self.agent_ids}
        rows = [
            (step, agent_id, name, values.astype(np.float32).tobytes())
            for step, agent_id, name, values in observation_notes(frame, row, kept, origin)
        ]
        rows += [
            (step, agent_id, name, values.tobytes())
            for (agent_id, name), (step, values) in self._features.items()
        ]
        self._seen, self._features = {}, {}
        return rows
