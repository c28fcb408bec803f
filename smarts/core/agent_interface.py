"""Alias of `smarts.agents`."""

from smarts.agents import *  # noqa: F403
