"""Floor policies: what can be reached without learning.

They see what learners see, the vector of `smarts.env.adapters.benchmark` and the mask, and use the same four
actions.
"""

from smarts.registry import Registry

FLOORS = Registry(
    "floor policy",
    {
        "keep_lane": "benchmark.floors.keep_lane:KeepLane",
        "parked": "benchmark.floors.parked:Parked",
        "random": "benchmark.floors.random_actions:RandomActions",
        "yielder": "benchmark.floors.yielder:Yielder",
    },
)
"""Name -> "module:Class" of a `benchmark.floors.protocol.Floor`."""

SUMO_DRIVER = "sumo_driver"
"""SUMO's own driver, who has no actions and sees more: a row of its own beside `FLOORS`."""
