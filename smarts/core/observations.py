"""Alias of `smarts.sensors.observation`."""

from smarts.sensors.observation import Observation

__all__ = ["Observation"]
