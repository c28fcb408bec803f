"""Sets: rows in any order, such as the neighbours of a vehicle, to one vector."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class SetEncoder(nn.Module):
    """Rows of a set to one vector that does not depend on their order: Deep Sets (Zaheer et al., 2017).

    Every row goes through the same two layers; the vector is the largest and the summed value of each unit,
    the sum over the number of places. A row of zeros is an empty place, which is not computed and contributes
    nothing; the vector of an empty set is zero.

    Args:
        places: Number K of rows.
        features: Numbers F in each.
        width: Units H of the layers.
    """

    def __init__(self, places: int, features: int, width: int) -> None:
        super().__init__()
        self.size = 2 * width
        """Numbers in the vector."""
        self._places = places
        self.layers = nn.Sequential(nn.Linear(features, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU())

    def forward(self, rows: Tensor) -> Tensor:
        """Return vectors (..., 2 H) of sets (..., K, F)."""
        every = rows.flatten(0, -2)
        taken = (every != 0).any(-1).nonzero().squeeze(-1)
        computed = self.layers(every.index_select(0, taken))
        units = computed.new_zeros(len(every), self.size // 2).index_copy(0, taken, computed)
        units = units.unflatten(0, rows.shape[:-1])
        # No unit is below zero after the rectifier: the zero of an empty place exceeds none.
        return torch.cat([units.amax(-2), units.sum(-2) / self._places], -1)
