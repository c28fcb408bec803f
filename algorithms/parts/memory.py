"""Memory of policies: a recurrent unit, stepped while acting and unrolled over sequences while learning."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class GRUMemory(nn.Module):
    """Cho et al. 2014's gated recurrent unit, for n agents at once.

    Args:
        features: Width of its input.
        size: Width H of the memory.
    """

    def __init__(self, features: int, size: int) -> None:
        super().__init__()
        self.cell = nn.GRUCell(features, size)

    def forward(self, features: Tensor, start: Tensor, fresh: Tensor | None, length: int) -> Tensor:
        """Return the memory (L * C, n, H) after each row, rows in order of time, then of sequence.

        Args:
            features: (L * C, n, d): C sequences of L steps.
            start: Stored memory before each row, (L * C, n, H); only that of the first step of each sequence
                is used.
            fresh: Where another trajectory begins, whose memory is empty, (L * C, n); the first step's are
                ignored, since its stored memory is empty already. None: nowhere.
            length: L.
        """
        steps = features.unflatten(0, (length, -1))
        memory = start.unflatten(0, (length, -1))[0].flatten(0, 1)
        borders = None if fresh is None else fresh.unflatten(0, (length, -1))
        kept = []
        for step in range(length):
            if step and borders is not None:
                memory = memory.masked_fill(borders[step].flatten()[:, None], 0)
            memory = self.cell(steps[step].flatten(0, 1), memory)
            kept.append(memory.unflatten(0, steps.shape[1:3]))
        return torch.cat(kept)
