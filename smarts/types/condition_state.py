"""What a condition of a scenario can evaluate to."""

from __future__ import annotations

from enum import IntFlag
from typing import Any, Protocol


class ConditionState(IntFlag):
    """Whether a condition holds and, where it does not, whether it has held or can hold."""

    FALSE = 0
    """Does not hold."""
    BEFORE = 1
    """Does not hold yet."""
    EXPIRED = 2
    """Will never hold (again)."""
    TRUE = 4
    """Holds."""

    def __bool__(self) -> bool:
        return ConditionState.TRUE in self


class SceneCondition(Protocol):
    """A condition of the scenario language: one on an agent's entry, or one of a bubble."""

    def evaluate(self, *, memory: Any = None, **facts: Any) -> Any:
        """Return whether it holds; the facts are those of `smarts.sstudio.sstypes.condition`."""
        ...

    @property
    def requires(self) -> Any:
        """The facts that it looks at."""
        ...
