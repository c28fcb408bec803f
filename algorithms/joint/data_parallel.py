"""Several learners that take equal steps: each minibatch is split by rows, gradients are averaged.

All learners hold the same networks, replay and random numbers, and get the same rollouts. Each processes its
own rows of every minibatch. What they compute fulfils one rule: its average over the learners is what one
learner computes of all rows. A minibatch that all of them process whole fulfils it, too.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

import torch
from torch import Tensor, distributed

from algorithms.joint.batch import JointBatch
from algorithms.parts.noise import RowGenerator

logger = logging.getLogger(__name__)

B = TypeVar("B", bound=JointBatch)
FAILURE = "failure"
"""Key of what one of several learners returns in place of results: its error."""


class DataParallel:
    """One learner's place among several; with one learner, every method returns its argument.

    Args:
        generator: The learner's random numbers, which are drawn for whole minibatches.
        size: Number of learners.
        rank: Number of this one.
    """

    def __init__(self, generator: RowGenerator, *, size: int = 1, rank: int = 0) -> None:
        self.size, self.rank = size, rank
        self._generator = generator

    @contextmanager
    def own_rows(self, batch: B) -> Iterator[B]:
        """Provide this learner's rows of a minibatch, or all rows, if there are fewer than learners.

        Sequences stay whole. Inside the block random numbers are drawn for these rows.
        """
        count = len(batch) // batch.length
        if self.size == 1 or count < self.size:
            yield batch
            return
        rows = batch.rows_of(torch.arange(self.rank, count, self.size, device=batch.alive.device))
        self._generator.rows = rows.to(self._generator.device), len(batch)
        try:
            yield batch.part_at(rows)
        finally:
            self._generator.rows = None

    def average(self, tensors: Sequence[Tensor]) -> list[Tensor]:
        """Return the averages over learners of tensors of one type, which have the same shapes everywhere."""
        if self.size == 1 or not tensors:
            return list(tensors)
        flat = torch.cat([tensor.reshape(-1) for tensor in tensors])
        distributed.all_reduce(flat)
        parts = (flat / self.size).split([tensor.numel() for tensor in tensors])
        return [part.view(tensor.shape) for part, tensor in zip(parts, tensors, strict=True)]

    def count(self, own: Tensor) -> Tensor:
        """Return the divisor for sums over own rows, of the numbers of own rows: at least 1 over all rows."""
        if self.size == 1:
            return own.clamp(min=1)
        (average,) = self.average([own.float()])
        return average.clamp(min=1 / self.size)

    def whole(self, own: Tensor) -> Tensor:
        """Return the values (M,) of all rows of the minibatch, given those of the own rows."""
        if self._generator.rows is None:
            return own
        rows, total = self._generator.rows
        values = own.new_zeros(total).index_copy_(0, rows.to(own.device), own)
        distributed.all_reduce(values)
        return values

    def broadcast(self, *tensors: Tensor) -> None:
        """Overwrite tensors by those of the first learner."""
        for tensor in tensors if self.size > 1 else ():
            distributed.broadcast(tensor.detach(), 0)

    def failure(self, error: Exception) -> dict[str, str]:
        """Return the error of one of several learners as its results, upon which the driver ends the others.

        If it only raised, its number would be lost.
        """
        if self.size == 1:
            raise error
        logger.error("learner %d has failed", self.rank, exc_info=error)
        return {FAILURE: f"{type(error).__name__}: {error}"}
