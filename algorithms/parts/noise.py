"""Random numbers of a generator on the CPU, for tensors on any device: equal seeds draw equal numbers."""

from __future__ import annotations

import torch
from torch import Generator, Tensor


class RowGenerator(Generator):
    """A generator that can draw for some rows what it would draw for all of them.

    Attributes:
        rows: Numbers (m,) of the rows and how many there are in all; None: all.
    """

    rows: tuple[Tensor, int] | None = None


def exponential(like: Tensor, generator: Generator) -> Tensor:
    """Return exponentially distributed numbers of the shape, type and device of `like`."""
    rows = generator.rows if isinstance(generator, RowGenerator) else None
    shape = like.shape if rows is None else (rows[1], *like.shape[1:])
    drawn = torch.empty(shape, dtype=like.dtype, device=generator.device).exponential_(generator=generator)
    return (drawn if rows is None else drawn[rows[0]]).to(like.device)
