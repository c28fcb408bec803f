"""Scripted policies: what can be reached without learning.

They see what learners see and use the same actions. Those of this package are made for the vector of
`smarts.env.adapters.benchmark`, its mask and the four lane actions.
"""

from typing import Any

from smarts.registry import Registry


def _adopt(name: str, found: Any) -> Any:
    """Return the class of a user's scripted policy, of which one can be made."""
    if not isinstance(found, type):
        raise ValueError(f"is {found!r}, no class")
    for method in ("begin", "act"):
        if not callable(getattr(found, method, None)):
            raise ValueError(f"has no method {method!r}: see benchmark/floors/protocol.py")
    found()
    return found


FLOORS = Registry(
    "scripted policy",
    {
        "keep_lane": "benchmark.floors.keep_lane:KeepLane",
        "parked": "benchmark.floors.parked:Parked",
        "random": "benchmark.floors.random_actions:RandomActions",
        "yielder": "benchmark.floors.yielder:Yielder",
    },
    _adopt,
)
"""Name -> "module:Class" of a `benchmark.floors.protocol.Floor`; a user's own is such a name."""

SUMO_DRIVER = "sumo_driver"
"""SUMO's own driver, who has no actions and sees more: a row of its own beside `FLOORS`."""
