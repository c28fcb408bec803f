"""Agents: whatever turns an observation into an action. They are defined in the agents' kit."""

from __future__ import annotations

from smarts_agent_kit.agents import LONGEST_DECISION, ActionBatch, Agent, AgentPolicy, BatchAgent

__all__ = ["LONGEST_DECISION", "ActionBatch", "Agent", "AgentPolicy", "BatchAgent"]
