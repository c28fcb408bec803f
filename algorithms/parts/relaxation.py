"""Discrete actions through which gradients flow."""

from __future__ import annotations

import torch
from torch import Generator, Tensor

from algorithms.parts.masking import MASKED_LOGIT
from algorithms.parts.noise import exponential


def straight_through_gumbel(
    logits: Tensor, action_mask: Tensor | None, generator: Generator, temperature: float = 1.0
) -> Tensor:
    """Return one-hot samples (..., A) with the gradient of the relaxed sample.

    Jang et al. 2017, "Categorical Reparameterization with Gumbel-Softmax", eq. 2 and section 2.2.
    """
    if action_mask is not None:
        logits = logits.masked_fill(~action_mask, MASKED_LOGIT)
    gumbel = -exponential(logits, generator).log()
    relaxed = torch.softmax((logits + gumbel) / temperature, -1)
    hard = torch.zeros_like(relaxed).scatter_(-1, relaxed.argmax(-1, keepdim=True), 1.0)
    if not relaxed.requires_grad:
        return hard
    return hard + (relaxed - relaxed.detach())  # the bracket is exactly zero
