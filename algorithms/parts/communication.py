"""Masks and means for communication between agents."""

from __future__ import annotations

import torch
from torch import Tensor


def others(alive: Tensor) -> Tensor:
    """Return which agents hear which, (..., N, N): `[i, j]` is True for active j other than i."""
    self_ = torch.eye(alive.shape[-1], dtype=torch.bool, device=alive.device)
    return alive.unsqueeze(-2) & ~self_


def mean_of_others(hidden: Tensor, alive: Tensor) -> Tensor:
    """Return for each agent the mean of the other active agents' `hidden` (..., N, H); zeros if alone."""
    return mean_over(others(alive), hidden)


def mean_over(neighbours: Tensor, x: Tensor) -> Tensor:
    """Return for each agent the mean of its neighbours' `x` (..., N, H); zeros for one without neighbours.

    Args:
        neighbours: `[i, j]`: j counts for i, (..., N, N).
        x: (..., N, H).
    """
    counted = neighbours.to(x.dtype)
    return (counted / counted.sum(-1, keepdim=True).clamp(min=1)) @ x
