"""Adapters: an observation and a reward, as environments use them."""

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
            "ObservationAndReward"
        )
    return found


ADAPTERS = Registry(
    "adapter",
    {name: f"smarts.env.adapters.adapter:{name}" for name in ("benchmark", "paper", "raw")},
    _adopt,
)
"""Name -> "module:function" that makes an `ArrayAdapter`; a user's own is such a "module:function"."""
