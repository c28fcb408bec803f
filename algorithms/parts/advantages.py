"""Generalised advantage estimation over trajectories that begin and end anywhere in a fragment."""

from __future__ import annotations

import torch
from torch import Tensor


def generalised_advantages(
    rewards: Tensor,
    values: Tensor,
    final_values: Tensor,
    final_at: Tensor,
    bootstrap: Tensor,
    chain: Tensor,
    *,
    gamma: float,
    lambda_: float,
) -> tuple[Tensor, Tensor]:
    """Return advantages and value targets, each (T, B, N); meaningful where an agent acted.

    Schulman et al. 2016, eq. 11-16, with the masks of `algorithms.joint.masks`:

        delta[t] = r[t] + gamma * bootstrap[t] * V'[t] - V[t]
        A[t]     = delta[t] + gamma * lambda * chain[t] * A[t + 1]

    where V'[t] is V[t + 1] where the trajectory continues in the next row, and the value of its final row
    where it does not.

    Args:
        rewards: (T, B, N).
        values: V of all moments, (T + 1, B, N).
        final_values: V of the final rows, (K, N).
        final_at: Places (t, b) of the final rows, (K, 2).
        bootstrap: Alive and not terminated, (T, B, N).
        chain: The trajectory continues in the next row, (T, B, N).
        gamma: Discount.
        lambda_: Weight of longer returns: 0 is TD(0), 1 is Monte Carlo.
    """
    following = values[1:].clone()
    t, b = final_at[:, 0], final_at[:, 1]
    following[t, b] = torch.where(chain[t, b], following[t, b], final_values)
    delta = rewards + gamma * torch.where(bootstrap, following, 0) - values[:-1]
    advantages = torch.empty_like(delta)
    weight = gamma * lambda_ * chain
    running = torch.zeros_like(delta[0])
    for step in range(len(delta) - 1, -1, -1):
        running = delta[step] + weight[step] * running
        advantages[step] = running
    return advantages, advantages + values[:-1]
