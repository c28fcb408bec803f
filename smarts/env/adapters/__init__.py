"""Adapters: frames -> observations and rewards, actions of an environment -> actions of the simulation."""

from smarts.registry import Registry

ADAPTERS = Registry("adapter", {})
"""Name -> "module:Class" of a `smarts.env.adapters.protocol.ArrayAdapter`."""
