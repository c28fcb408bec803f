"""Running mean and scale of value targets and rewards."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from algorithms.parts.masking import masked_mean


class RunningMoments(nn.Module):
    """Debiased exponential averages of mean and mean square, kept as buffers, so checkpoints carry them.

    They are of 64 bits: the variance is a difference of squares, whatever the mean. No standard deviation
    is taken to be below 0.01.

    Rewards of driving are metres, crashes and bonuses at once; critics fit their standardised values (the
    first of the details that matter in Yu et al. 2022, "The Surprising Effectiveness of PPO").

    Args:
        enabled: False: `scaled` and `unscaled` change nothing.
        decay: Share of the old averages that an observation leaves in place.
    """

    def __init__(self, *, enabled: bool, decay: float = 0.99) -> None:
        super().__init__()
        self._enabled, self._decay = enabled, decay
        self.mean = nn.Buffer(torch.zeros((), dtype=torch.float64))
        self.mean_square = nn.Buffer(torch.zeros((), dtype=torch.float64))
        self.weight = nn.Buffer(torch.zeros((), dtype=torch.float64))

    def observe(self, x: Tensor, mask: Tensor, decay: float | None = None) -> None:
        """Update the averages with the values of `x` where `mask`, with another `decay` if one is given."""
        if self._enabled and bool(mask.any()):
            share = 1 - (self._decay if decay is None else decay)
            x = x.double()
            self.mean.lerp_(masked_mean(x, mask), share)
            self.mean_square.lerp_(masked_mean(x.square(), mask), share)
            self.weight.lerp_(torch.ones_like(self.weight), share)

    def scaled(self, x: Tensor) -> Tensor:
        """Return standardised values."""
        if not self._enabled:
            return x
        mean, std = self._moments(x)
        return (x - mean) / std

    def unscaled(self, x: Tensor) -> Tensor:
        """Return values in the units of the rewards."""
        if not self._enabled:
            return x
        mean, std = self._moments(x)
        return x * std + mean

    def _moments(self, like: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean and scale, of the type of other values."""
        weight = self.weight.clamp(min=1e-5)
        mean = self.mean / weight
        variance = (self.mean_square / weight - mean.square()).clamp(min=1e-4)
        # Before the first observation the scale is one.
        return mean.to(like.dtype), torch.where(self.weight > 0, variance, 1).sqrt().to(like.dtype)
