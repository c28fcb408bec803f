"""What algorithms say about decisions: of each name the newest, until the next frame takes it along."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Bools, Floats, Ints


class PublishedExtras:
    """The newest annotations of some simulations.

    Most of them are replaced before a frame is due, so they are only copied.

    Args:
        rows: R, the simulations: the first ones of all B.
    """

    def __init__(self, rows: int) -> None:
        self._kept: list[dict[str, tuple[int, NDArray, Floats]]] = [{} for _ in range(rows)]
        """The newest values of each simulation by name: step, agents, and their values, shape (n, ...)."""

    def take(self, name: str, values: ArrayLike, agent_ids: Bools, steps: Ints) -> None:
        """Take an annotation; it replaces older ones of its name in the simulations that it is about.

        Args:
            name: What the values are.
            values: Values of each agent, shape (B, A, ...).
            agent_ids: Which agents it is about, shape (B, A).
            steps: Steps of the decisions, shape (B,).
        """
        table = np.asarray(values)
        for row, kept in enumerate(self._kept):
            agents = np.flatnonzero(agent_ids[row])
            if len(agents):
                # A copy: the caller may reuse its arrays.
                kept[name] = int(steps[row]), agents, table[row, agents].astype(np.float64)

    def pop(self, row: int) -> list[tuple[int, int, str, list[float]]]:
        """Return step, agent_id, name and values of what is new in a simulation; forget it."""
        kept, self._kept[row] = self._kept[row], {}
        return [
            (step, agent, name, np.ravel(values).tolist())
            for name, (step, agents, table) in kept.items()
            for agent, values in zip(agents.tolist(), table, strict=True)
        ]
