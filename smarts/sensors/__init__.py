"""Sensors: one file each, pure functions of the scene, batched over the agents of all simulations."""

from smarts.agents.sensors import SENSORS as SENSORS
