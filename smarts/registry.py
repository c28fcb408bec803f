"""Registries: names of parts that are imported only when one is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from typing import Any

from smarts.errors import UnknownNameError, nearest_names


class Registry(Mapping[str, Any]):
    """Parts of one kind by name. Listing the names imports nothing.

    Args:
        kind: What the parts are, for errors: "sensor".
        places: "module:attribute" of each name.
    """

    def __init__(self, kind: str, places: Mapping[str, str]) -> None:
        self.kind = kind
        self._places = dict(places)

    def __getitem__(self, name: str) -> Any:
        """Import and return a part.

        Raises:
            UnknownNameError: There is none of this name; the remedy names the nearest ones.
        """
        if name not in self._places:
            raise UnknownNameError(
                f"there is no {self.kind} {name!r}", remedy=nearest_names(name, self._places)
            )
        module, _, attribute = self._places[name].partition(":")
        return getattr(importlib.import_module(module), attribute)

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)
