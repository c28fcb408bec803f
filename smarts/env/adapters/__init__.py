"""Adapters: frames -> observations and rewards, actions of an environment -> actions of the simulation."""

from smarts.registry import Registry

ADAPTERS = Registry(
    "adapter",
    {
        "benchmark": "smarts.env.adapters.benchmark:BenchmarkAdapter",
        "raw": "smarts.env.adapters.raw:RawAdapter",
    },
)
"""Name -> "module:Class" of a `smarts.env.adapters.protocol.ArrayAdapter`."""
