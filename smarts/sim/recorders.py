"""What takes frames: a recorder, a publisher, or both."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from smarts.arrays import Bools, Ints
from smarts.types.frame import Frame


class AnnotatedRecorder(Protocol):
    """Takes frames, and what is said about them; see `smarts.sim.recorder.EpisodeRecorder`."""

    @property
    def observers(self) -> Bools | None:
        """Agents whose observations are wanted now, shape (B, A); None: of no agent."""
        ...

    @property
    def wants_terms(self) -> bool:
        """Whether the terms of rewards are wanted now."""
        ...

    def record(self, frame: Frame) -> None:
        """Take what is wanted out of a frame, before the next step overwrites it."""
        ...

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Take what an algorithm says about its decisions, or what came of them."""
        ...

    def finish(self, env_mask: Bools) -> None:
        """Know that all has been said about the episodes of some simulations."""
        ...

    def close(self) -> None:
        """End; may be called again."""
        ...


class Recorders:
    """Several recorders as one.

    Args:
        parts: The recorders, in the order in which they get a frame.
    """

    def __init__(self, parts: Sequence[AnnotatedRecorder]) -> None:
        self._parts = tuple(parts)

    @property
    def observers(self) -> Bools | None:
        """Agents whose observations one of them wants now, shape (B, A); None: of no agent."""
        masks = [mask for mask in (part.observers for part in self._parts) if mask is not None]
        return np.logical_or.reduce(masks) if masks else None

    @property
    def wants_terms(self) -> bool:
        """Whether one of them wants the terms of rewards now."""
        return any(part.wants_terms for part in self._parts)

    def record(self, frame: Frame) -> None:
        """Give all of them a frame."""
        for part in self._parts:
            part.record(frame)

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Give all of them an annotation."""
        for part in self._parts:
            part.annotate(name, values, agent_ids, step)

    def finish(self, env_mask: Bools) -> None:
        """Tell all of them."""
        for part in self._parts:
            part.finish(env_mask)

    def close(self) -> None:
        """Close all of them, also if one fails."""
        with ExitStack() as stack:
            for part in reversed(self._parts):
                stack.callback(part.close)
