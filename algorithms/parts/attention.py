"""Attention of each agent to the other active agents."""

from __future__ import annotations

import torch
from torch import Tensor

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
