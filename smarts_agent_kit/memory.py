"""What an agent remembers of each of its vehicles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts_agent_kit.agents import ActionBatch


class Memory:
    """Numbers that a policy keeps of each vehicle between its decisions, zero at a vehicle's first.

    In a bubble's air-lock, where the policy does not drive yet, nothing is kept.

    Args:
        width: Numbers of each vehicle.
    """

    def __init__(self, width: int) -> None:
        self._rows: dict[tuple[int, int], int] = {}
        self._values = np.zeros((16, width))
        self._is_kept = np.zeros(16, np.bool_)

    def of(self, batch: ActionBatch) -> NDArray[np.float64]:
        """Return a copy of what is kept of a batch's vehicles, shape (N, width)."""
        rows = self._rows_of(batch)
        return np.where(self._is_kept[rows, None] & ~batch.is_first[:, None], self._values[rows], 0.0)

    def is_new(self, batch: ActionBatch) -> NDArray[np.bool_]:
        """Return of which vehicles nothing is kept, shape (N,)."""
        return ~self._is_kept[self._rows_of(batch)] | batch.is_first

    def keep(self, batch: ActionBatch, values: NDArray[np.float64]) -> None:
        """Keep the numbers of those of a batch's vehicles that are driven, shape (N, width)."""
        rows = self._rows_of(batch)
        self._values[rows], self._is_kept[rows] = values, batch.drives

    def _rows_of(self, batch: ActionBatch) -> NDArray[np.int32]:
        keys = zip(batch.env_id.tolist(), batch.agent_id.tolist(), strict=True)
        rows = [self._rows.setdefault(key, len(self._rows)) for key in keys]
        missing = len(self._rows) - len(self._values)
        if missing > 0:
            more = np.zeros((missing + len(self._values), self._values.shape[1]))
            self._values = np.concatenate([self._values, more])
            self._is_kept = np.concatenate([self._is_kept, np.zeros(len(more), np.bool_)])
        return np.array(rows, np.int32)
