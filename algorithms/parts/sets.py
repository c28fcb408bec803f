"""Sets: rows in any order, such as the neighbours of a vehicle, to one vector."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class SetEncoder(nn.Module):
    """Rows of a set to one vector that does not depend on their order: Deep Sets (Zaheer et al., 2017).

    Every row goes through the same two layers; the vector is the largest and the summed value of each unit,
    the sum over the number of places. A row of zeros is an empty place and contributes nothing; the
    vector of an empty set is zero.

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
        is_present = (rows != 0).any(-1, keepdim=True)
        if torch.is_grad_enabled():
            units = self._units_of_present(rows, is_present)
        else:  # every row, so that what an agent does never depends, in its last bits, on what others see
            units = self.layers(rows) * is_present
        # No unit is below zero after the rectifier: the zero of an empty place exceeds none.
        return torch.cat([units.amax(-2), units.sum(-2) / self._places], -1)

    def _units_of_present(self, rows: Tensor, is_present: Tensor) -> Tensor:
        """Return units (..., K, H), computed for non-empty rows alone: often fewer than half."""
        flat, present = rows.flatten(0, -2), is_present.flatten().nonzero().squeeze(-1)
        units = self.layers(flat.index_select(0, present))
        spread = units.new_zeros(len(flat), units.shape[-1]).index_copy(0, present, units)
        return spread.unflatten(0, rows.shape[:-1])
