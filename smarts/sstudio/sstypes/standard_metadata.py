"""Facts about a scenario that do not change what happens in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from smarts.sstudio.sstypes.identity import Described


class StandardMetadata(Described, Mapping[str, Any]):
    """Named facts; those that are None count as not given."""

    def __init__(self, metadata: Mapping[str, Any] | None = None) -> None:
        self._facts = {key: value for key, value in (metadata or {}).items() if value is not None}

    @property
    def constructor_arguments(self) -> dict[str, Any]:
        """Arguments that make an equal object."""
        return {"metadata": dict(self._facts)}

    def __getitem__(self, key: str) -> Any:
        return self._facts[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._facts)

    def __len__(self) -> int:
        return len(self._facts)

    # Mapping brings its own equality, by items and without regard to the type.
    __eq__ = Described.__eq__
    __hash__ = Described.__hash__

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._facts!r})"
