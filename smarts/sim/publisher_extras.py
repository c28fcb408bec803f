"""What algorithms say about decisions: of each name the newest, until the next frame takes it along."""

from __future__ import annotations

from itertools import repeat

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Bools, Ints


class PublishedExtras:
    """The newest annotations of some simulations.

    Most of them are replaced before a frame is due, so they are only copied, for all simulations at once.

    Args:
        rows: R, the simulations: the first ones of all B.
    """

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._kept: dict[str, tuple[NDArray, Bools, Ints]] = {}
        """Name -> values (R, A, ...), agents (R, A) and steps (R,)."""

    def take(self, name: str, values: ArrayLike, agent_ids: Bools, steps: Ints) -> None:
        """Take an annotation; it replaces older ones of its name in the simulations that it is about.

        Args:
            name: What the values are.
            values: Values of each agent, shape (B, A, ...).
            agent_ids: Which agents it is about, shape (B, A).
            steps: Steps of the decisions, shape (B,).
        """
        # Copies: the caller may reuse its arrays.
        agents = np.array(agent_ids[: self._rows])
        is_new = agents.any(axis=1)
        if not np.count_nonzero(is_new):
            return
        table = np.array(np.asarray(values)[: self._rows], np.float64)
        numbers = np.array(steps[: self._rows])
        before = self._kept.get(name)
        if before is not None and before[0].shape == table.shape:
            old = ~is_new
            if np.count_nonzero(old):
                for new, kept in zip((table, agents, numbers), before, strict=True):
                    new[old] = kept[old]
        self._kept[name] = table, agents, numbers

    def pop(self, row: int) -> list[tuple[int, int, str, list[float]]]:
        """Return step, agent_id, name and values of what is new in a simulation; forget it."""
        found: list[tuple[int, int, str, list[float]]] = []
        for name, (table, agents, steps) in self._kept.items():
            chosen = np.flatnonzero(agents[row])
            if len(chosen):
                values = table[row, chosen].reshape(len(chosen), -1).tolist()
                found += zip(repeat(int(steps[row])), chosen.tolist(), repeat(name), values)
                agents[row] = False
        return found
