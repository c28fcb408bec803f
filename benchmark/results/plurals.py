"""Words with a number, in the singular or the plural."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any


def counted(count: int, name: str) -> str:
    """Return "1 seed" or "2 seeds"."""
    return f"{count} {name}{'' if count == 1 else 's'}"


def listed(name: str, values: Collection[Any]) -> str:
    """Return "seed 1" or "seeds 1, 2"."""
    return f"{name}{'' if len(values) == 1 else 's'} {', '.join(map(str, values))}"
