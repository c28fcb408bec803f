"""Facts about a scenario that do not change what happens in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smarts.sstudio.sstypes.identity import DescribedMapping


class StandardMetadata(DescribedMapping):
    """Named facts; those that are None count as not given."""

    def __init__(self, metadata: Mapping[str, Any] | None = None) -> None:
        super().__init__({key: value for key, value in (metadata or {}).items() if value is not None})

    @property
    def constructor_arguments(self) -> dict[str, Any]:
        """Arguments that make an equal object."""
        return {"metadata": dict(self._items)}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._items!r})"
