"""Graphs between agents: well-known ones, how neighbours average, and how fast that makes all agree."""

from __future__ import annotations

import torch
from torch import Tensor


def complete(agents: int) -> Tensor:
    """Return the graph (N, N) in which all agents are neighbours."""
    return ~torch.eye(agents, dtype=torch.bool)


def ring(agents: int) -> Tensor:
    """Return the graph (N, N) in which each agent has the one before and the one after as neighbours."""
    place = torch.arange(agents)
    step = (place[:, None] - place[None, :]) % agents
    return ((step == 1) | (step == agents - 1)) & complete(agents)


def within(positions: Tensor, radius: float) -> Tensor:
    """Return which other agents are within a distance, (..., N, N), for positions (..., N, d)."""
    near = torch.cdist(positions, positions, compute_mode="donot_use_mm_for_euclid_dist") <= radius
    return near & complete(positions.shape[-2]).to(near.device)


def metropolis(links: Tensor) -> Tensor:
    """Return the Metropolis weights (N, N) of an undirected graph without self-loops: doubly stochastic.

    Xiao, Boyd & Lall 2005, "A Scheme for Robust Distributed Sensor Fusion Based on Average Consensus":
    1 / (1 + the larger of the two degrees) for neighbours, and what is left for the agent itself.
    """
    degrees = links.sum(-1)
    weights = links / (1 + torch.maximum(degrees[:, None], degrees[None, :]))
    return weights + torch.diag(1 - weights.sum(-1))


def consensus_rate(weights: Tensor) -> float:
    """Return the factor by which one round of averaging shrinks disagreement, in the long run.

    That is the second-largest *modulus* of the eigenvalues of a doubly stochastic matrix: 0 agrees at once, 1
    never. Agents on a ring of 4 that keep nothing of their own have the eigenvalue -1.
    """
    moduli = torch.linalg.eigvals(weights.double()).abs().sort(descending=True).values
    return float(moduli[1]) if len(moduli) > 1 else 0.0
