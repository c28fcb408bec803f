"""Scenario objects from the plain data that `smarts.sstudio.encoding` makes of them."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from smarts.sstudio import sstypes
from smarts.sstudio.encoding import CALLABLE, ENUM, MEMBERS, NUMBER, PAIRS, TYPE, Json
from smarts.types.colors import Colors, SceneColors


@dataclass(frozen=True)
class CallableReference:
    """A function or class that a scenario names, not yet imported."""

    path: str
    """Path as "module:name"."""

    def load(self) -> Callable[..., Any]:
        """Import and return what is meant."""
        module, _, name = self.path.partition(":")
        found: Any = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
        return found


_TYPES: dict[str, Any] = {name: kind for name, kind in vars(sstypes).items() if isinstance(kind, type)} | {
    "Colors": Colors,
    "SceneColors": SceneColors,
}


def decode(data: Json) -> Any:
    """Return the scenario object that `data` describes; lists become tuples."""
    if isinstance(data, list):
        return tuple(decode(item) for item in data)
    if not isinstance(data, dict):
        return data
    for mark, decoder in _DECODERS.items():
        if mark in data:
            return decoder(data)
    return {key: decode(item) for key, item in data.items()}


def _decode_object(data: dict[str, Json]) -> Any:
    return _TYPES[data[TYPE]](**{key: decode(item) for key, item in data.items() if key != TYPE})


def _decode_enum(data: dict[str, Json]) -> Any:
    kind, value = _TYPES[data[ENUM]], data["value"]
    return kind[value] if isinstance(value, str) else kind(value)


@lru_cache(maxsize=1024)
def _decode_key(text: str) -> Any:
    """Return an object from its JSON; equal ones share one in memory, as the drivers of all flows do."""
    return decode(json.loads(text))


_DECODERS: dict[str, Callable[[dict[str, Json]], Any]] = {
    TYPE: _decode_object,
    ENUM: _decode_enum,
    PAIRS: lambda data: {_decode_key(json.dumps(key)): decode(item) for key, item in data[PAIRS]},
    MEMBERS: lambda data: frozenset(decode(item) for item in data[MEMBERS]),
    CALLABLE: lambda data: CallableReference(data[CALLABLE]),
    NUMBER: lambda data: float(data[NUMBER]),
}
