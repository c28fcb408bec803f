"""Social agents: they are asked for actions while the user's agents compute theirs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from smarts.agents.acting import ActionRequest, AgentHost
from smarts.arrays import Bools
from smarts.env.actions import ActionEncoder
from smarts.sim.agent_pool import AgentPool
from smarts.types.agent_states import AgentStatus
from smarts.types.frame import Frame
from smarts.types.world import World

_ACTIVE, _SHADOWING = int(AgentStatus.ACTIVE), int(AgentStatus.SHADOWING)


@dataclass(frozen=True)
class SocialAgents:
    """The policies of the agents that are no egos."""

    acting: AgentHost
    observe: Callable[[Frame, int, int], Any]
    """Makes the observation of (row, agent_id) out of a frame; it stays valid after the frame."""
    deadline: float = 0.5
    """How long to wait for answers [s]."""


class SocialAgentRequests:
    """The decisions that social agents have been asked for, and have not answered yet.

    Args:
        agents: The agents.
        world: The state; `next_due` of the agents is written.
        pool: Knows which agent holds a column.
        encoder: Takes their actions.
    """

    def __init__(self, agents: SocialAgents, world: World, pool: AgentPool, encoder: ActionEncoder) -> None:
        self.late = 0
        """Answers that did not come in time."""
        self._agents, self._world, self._pool, self._encoder = agents, world, pool, encoder
        self._open: dict[tuple[int, int], ActionRequest] = {}

    def dispatch(self, frame: Frame, due: Bools) -> None:
        """Ask the agents whose decision is due for their actions.

        Args:
            frame: The last one.
            due: Which simulations run and which agents have readings of now, shape (B, A).
        """
        world, agents = self._world, self._world.agents
        due = due & ((agents.state == _ACTIVE) | (agents.state == _SHADOWING))
        due &= agents.next_due <= world.step[:, None]
        due[:, : world.egos] = False
        asked = {}
        for row, agent_id in np.argwhere(due).tolist():
            step = int(world.step[row])
            name, hold = self._pool.name(row, agent_id), int(self._pool.serial[row, agent_id])
            request = ActionRequest(row, int(world.episode[row]), agent_id, name, hold, step)
            asked[request] = self._agents.observe(frame, row, agent_id)
            agents.next_due[row, agent_id] = step + agents.period[row, agent_id]
            self._open[row, agent_id] = request
        if asked:
            self._agents.acting.dispatch(asked)

    def gather(self) -> None:
        """Write the answers that have come; late agents keep the lasting part of their last action.

        Raises:
            ActionError: An action is not of the agent's type.
        """
        if not self._open:
            return
        for request, action in self._agents.acting.gather(self._agents.deadline).items():
            row, agent_id = place = request.row, request.agent_id
            if self._open.get(place) != request:
                continue
            del self._open[place]
            self._encoder.write([self._encoder.parse(request.name, action, row, agent_id)])
        self.late += len(self._open)
        self._open.clear()

    def forget(self, env_mask: Bools) -> None:
        """Drop the requests of some simulations; their answers are ignored when they come."""
        for place in [place for place in self._open if env_mask[place[0]]]:
            del self._open[place]

    def close(self) -> None:
        """End the agents; may be called again."""
        self._agents.acting.close()
