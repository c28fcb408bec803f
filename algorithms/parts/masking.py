"""Means over active agents, and the value that stands for a masked action."""

from __future__ import annotations

import torch
from torch import Tensor

MASKED_LOGIT = -1e9
"""Logit or value of a masked action: probability zero in float32, finite if all are."""


def masked_mean(x: Tensor, mask: Tensor) -> Tensor:
    """Return the mean of `x` where `mask`; what lies outside cannot change a bit of it."""
    return torch.where(mask, x, 0).sum() / mask.sum().clamp(min=1)


def masked_mean_of_agents(x: Tensor, mask: Tensor) -> Tensor:
    """Return the means (...) of `x` (..., N) where `mask`; 0 where it is nowhere."""
    return torch.where(mask, x, 0).sum(-1) / mask.sum(-1).clamp(min=1)


def standardised(x: Tensor, mask: Tensor, epsilon: float = 1e-8) -> Tensor:
    """Return `x` with mean 0 and standard deviation 1 over `mask`, and 0 elsewhere."""
    mean = masked_mean(x, mask)
    std = masked_mean((x - mean).square(), mask).sqrt()
    return torch.where(mask, (x - mean) / (std + epsilon), 0)
