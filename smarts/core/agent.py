"""Alias of `smarts.agents.policy`."""

from smarts.agents.policy import Agent

__all__ = ["Agent"]
