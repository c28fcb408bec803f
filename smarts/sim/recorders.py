"""What takes frames: a recorder, a publisher, or both."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from smarts.arrays import Bools, Ints
from smarts.types.frame import Frame


class Recorders:
    """Several recorders as one.

    Args:
        parts: What has the methods of `smarts.sim.recorder.EpisodeRecorder`, in the order in which they get a
            frame.
    """

    def __init__(self, parts: Sequence[Any]) -> None:
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
        """Give all of them a frame, before the next step overwrites it."""
        for part in self._parts:
            part.record(frame)

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Give all of them what an algorithm says about its decisions, or what came of them."""
        for part in self._parts:
            part.annotate(name, values, agent_ids, step)

    def finish(self, env_mask: Bools) -> None:
        """Have all recorders write the episodes of some simulations."""
        for part in self._parts:
            part.finish(env_mask)

    def close(self) -> None:
        """Close all of them, also if one fails; may be called again."""
        with ExitStack() as stack:
            for part in reversed(self._parts):
                stack.callback(part.close)
