"""Alias of `smarts.agents.spec`, under the original's module path."""

from smarts.agents.spec import AgentSpec

__all__ = ["AgentSpec"]
