"""Random numbers of a generator on the CPU, for tensors on any device: equal seeds draw equal numbers."""

from __future__ import annotations

import torch
from torch import Generator, Tensor


def exponential(like: Tensor, generator: Generator) -> Tensor:
    """Return exponentially distributed numbers of the shape, type and device of `like`."""
    drawn = torch.empty(like.shape, dtype=like.dtype, device=generator.device)
    return drawn.exponential_(generator=generator).to(like.device)
