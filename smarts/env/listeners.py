"""What environments give each step to: adapters, collectors, and notes for the record."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from numpy.typing import NDArray

from smarts.arrays import Bools
from smarts.types.frame import Frame


class StepListener(Protocol):
    """Receives every step, such as an array adapter."""

    def collect(self, frame: Frame, is_last: bool) -> object:
        """Take in one step of a decision, or a reset; `is_last` if the decision ends with it."""
        ...

    def reset(self, egos: Bools) -> None:
        """Begin episodes of these egos, shape (B, E)."""
        ...


class DecisionNotes(StepListener, Protocol):
    """Adds to the record what belongs to each decision."""

    @property
    def mask(self) -> Bools:
        """The egos that it is about, shape (B, E)."""
        ...

    def before_decision(self) -> None:
        """Record what is known as the egos decide."""
        ...

    def rewards(self) -> Mapping[str, NDArray]:
        """Return what the rewards of the last decision consist of, by name, shape (B, E)."""
        ...
