"""Adapters: frames -> observations and rewards."""

from typing import Any

from smarts.registry import Registry

_METHODS = ("collect", "reset")


def _adopt(name: str, found: Any) -> Any:
    """Return a user's adapter: a class with the methods of `ArrayAdapter`, or a function that makes one."""
    if not callable(found):
        raise ValueError(f"is {found!r}, neither a class nor a function that makes one")
    missing = [method for method in _METHODS if not callable(getattr(found, method, None))]
    if isinstance(found, type) and missing:
        raise ValueError(
            f"has no method {missing[0]!r}: see smarts/env/adapters/protocol.py, or derive it from "
            "BenchmarkAdapter"
        )
    return found


ADAPTERS = Registry(
    "adapter",
    {
        "benchmark": "smarts.env.adapters.benchmark:BenchmarkAdapter",
        "raw": "smarts.env.adapters.raw:RawAdapter",
    },
    _adopt,
)
"""Name -> "module:Class" of a `smarts.env.adapters.protocol.ArrayAdapter`; a user's own is such a name."""
