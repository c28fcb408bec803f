"""The agents that are observed and rewarded together."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.agents.interface import AgentInterface
from smarts.arrays import Bools, Ints
from smarts.roads.scene import Scene
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.frame import Frame

# A number: to compare an array with a member of an enumeration takes three times as long.
_ACTIVE = int(AgentStatus.ACTIVE)


@dataclass(frozen=True)
class AdapterContext:
    """Egos of all simulations that act in the same way."""

    scene: Scene
    agents: tuple[str, ...]
    """Their names."""
    agent_ids: Ints
    """Their rows of `AgentStates`, shape (G,)."""
    action: ActionSpaceType
    period: int
    """Steps from one decision to the next."""
    max_steps: int
    """Steps up to the time limit, 0 without one."""
    interfaces: tuple[AgentInterface, ...] = ()
    """Each agent's interface."""

    def ended(self, frame: Frame) -> Bools:
        """Return the agents whose episode ended in a step, shape (B, G)."""
        return frame.events.just_done[:, self.agent_ids]

    def present(self, frame: Frame) -> Bools:
        """Return the agents that were active in a step, or at a reset, shape (B, G)."""
        is_active = frame.world.agents.state[:, self.agent_ids] == _ACTIVE
        return (is_active & frame.env_mask[:, None]) | self.ended(frame)
