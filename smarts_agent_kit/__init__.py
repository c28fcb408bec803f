"""What an agent needs to act for the simulator from a process of its own: numpy, msgpack and this package."""

from smarts_agent_kit.agents import LONGEST_DECISION, ActionBatch, Agent, AgentPolicy, BatchAgent
from smarts_agent_kit.draws import uniform
from smarts_agent_kit.memory import Memory

__version__ = "1.0.0"

__all__ = [
    "LONGEST_DECISION",
    "ActionBatch",
    "Agent",
    "AgentPolicy",
    "BatchAgent",
    "Memory",
    "uniform",
]
