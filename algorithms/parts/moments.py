"""Running mean and scale of value targets and rewards."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from algorithms.parts.masking import masked_mean


class RunningMoments(nn.Module):
    """Debiased exponential averages of mean and variance, kept as buffers, so checkpoints carry them.

    Rewards of driving are metres, crashes and bonuses at once; critics fit their standardised values (the
    first of the details that matter in Yu et al. 2022, "The Surprising Effectiveness of PPO"). No standard
    deviation is taken to be below 0.01.

    Args:
        enabled: False: `scaled` and `unscaled` change nothing.
        decay: Share of the old averages that an observation leaves in place.
    """

    def __init__(self, *, enabled: bool, decay: float = 0.99) -> None:
        super().__init__()
        self._enabled, self._decay = enabled, decay
        self.mean = nn.Buffer(torch.zeros(()))
        self.variance = nn.Buffer(torch.zeros(()))
        self.weight = nn.Buffer(torch.zeros(()))

    def observe(self, x: Tensor, mask: Tensor, decay: float | None = None) -> None:
        """Update the averages with the values of `x` where `mask`, with another `decay` if one is given."""
        if self._enabled and bool(mask.any()):
            added = 1 - (self._decay if decay is None else decay)
            self.weight.lerp_(torch.ones_like(self.weight), added)
            share = added / self.weight
            mean = masked_mean(x, mask)
            variance = masked_mean((x - mean).square(), mask)
            # Of deviations, not as a difference of squares, which would lose a small variance beside a large
            # mean.
            apart = share * (1 - share) * (mean - self.mean).square()
            self.variance.lerp_(variance.to(self.variance.dtype), share).add_(apart)
            self.mean.lerp_(mean.to(self.mean.dtype), share)

    def scaled(self, x: Tensor) -> Tensor:
        """Return standardised values."""
        return (x - self.mean) / self._std() if self._enabled else x

    def unscaled(self, x: Tensor) -> Tensor:
        """Return values in the units of the rewards."""
        return x * self._std() + self.mean if self._enabled else x

    def _std(self) -> Tensor:
        # Before the first observation the scale is one.
        return torch.where(self.weight > 0, self.variance.clamp(min=1e-4), 1).sqrt()
