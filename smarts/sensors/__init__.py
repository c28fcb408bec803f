"""Sensors: one file each, pure functions of the scene, batched over the agents of all simulations."""

from smarts.registry import Registry

SENSORS = Registry("sensor", {})
"""Name of the option in `AgentInterface` -> "module:Class" of a `smarts.sensors.protocol.Sensor`."""
