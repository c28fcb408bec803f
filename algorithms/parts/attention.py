"""Attention between agents."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from algorithms.parts.communication import others
from algorithms.parts.masking import MASKED_LOGIT


def attend(queries: Tensor, keys: Tensor, values: Tensor, alive: Tensor) -> Tensor:
    """Return what each agent gathers from the others, (..., N, h, d); zeros for an agent that is alone.

    Args:
        queries: What agents ask for, by head, (..., N, h, d).
        keys: What others are found by, (..., N, h, d).
        values: What they give, (..., N, h, d).
        alive: (..., N).
    """
    heard = others(alive).unsqueeze(-3)
    scores = torch.einsum("...ihd,...jhd->...hij", queries, keys) / queries.shape[-1] ** 0.5
    # An agent that is alone would otherwise attend equally to all absent agents.
    weights = torch.softmax(scores.masked_fill(~heard, MASKED_LOGIT), -1) * heard
    return torch.einsum("...hij,...jhd->...ihd", weights, values)


class MultiHeadAttention(nn.Module):
    """Vaswani et al. 2017's attention of queries to places, by several heads of equal width.

    Args:
        width: Width H of queries, places and results.
        heads: Number of heads, which divides the width.
    """

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self._heads = heads, width // heads
        self.query, self.key, self.value, self.join = (nn.Linear(width, width) for _ in range(4))

    def forward(self, queries: Tensor, places: Tensor, heard: Tensor) -> Tensor:
        """Return (M, n, H) what each query gathers from the places (M, n, H) that it hears, (M, n, n)."""
        asked, found, given = (
            x.unflatten(-1, self._heads).transpose(-2, -3)
            for x in (self.query(queries), self.key(places), self.value(places))
        )
        scores = asked @ found.transpose(-1, -2) / self._heads[1] ** 0.5
        weights = torch.softmax(scores.masked_fill(~heard.unsqueeze(-3), MASKED_LOGIT), -1)
        return self.join((weights @ given).transpose(-2, -3).flatten(-2))
