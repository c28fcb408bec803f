"""The interface of the benchmark's agents."""

from __future__ import annotations

from typing import Any

from smarts.agents.criteria import DoneCriteria, EventConfiguration
from smarts.agents.interface import AgentInterface
from smarts.types.actions import ActionSpaceType

MAX_STEPS = 1000
"""Time limit of the benchmark's agents [steps of 0.1 s]."""
NOT_MOVING_TIME = 20.0
"""Time at a standstill that ends their episode [s]."""


def benchmark_interface(**changes: Any) -> AgentInterface:
    """Return the interface of the benchmark's agents, with some fields changed."""
    interface = AgentInterface(
        action=ActionSpaceType.Lane,
        max_episode_steps=MAX_STEPS,
        done_criteria=DoneCriteria(not_moving=True),
        event_configuration=EventConfiguration(not_moving_time=NOT_MOVING_TIME),
        accelerometer=False,
        lane_positions=False,
    )
    return interface.replace(**changes)
