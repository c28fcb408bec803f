"""The latest observations of agents as objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smarts.arrays import Bools
from smarts.roads.scene import Scene
from smarts.sensors.observation import Observation, ObservationMaker
from smarts.types.agent_states import AgentStatus
from smarts.types.frame import Frame

# A number: to compare with a member of an enumeration takes longer.
_ACTIVE = int(AgentStatus.ACTIVE)


class ObservationCollector:
    """Keeps the latest observations of some agents of the only simulation.

    Args:
        scene: The simulation.
        agent_ids: The agents.
    """

    def __init__(self, scene: Scene, agent_ids: Sequence[int]) -> None:
        self.seen: dict[int, Observation] = {}
        """Observations by agent_id."""
        self._make = ObservationMaker(scene)
        self._agent_ids = agent_ids
        # Since each agent's latest observation:
        self._events = dict.fromkeys(self._agent_ids, 0)
        self._touched: dict[int, list[str]] = {agent_id: [] for agent_id in self._agent_ids}

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Process a step, and make the observations of the agents whose decision ends with it."""
        # Lists: of a few agents, they are faster than arrays.
        bits, ended = frame.events.bits[0].tolist(), frame.events.just_done[0].tolist()
        state, is_stepped = frame.world.agents.state[0].tolist(), bool(frame.env_mask[0])
        if np.count_nonzero(frame.contacts.touching[0]):
            self._collect_touched(frame)
        for agent_id in self._agent_ids:
            self._events[agent_id] |= bits[agent_id]
            is_active = is_stepped and state[agent_id] == _ACTIVE
            if ended[agent_id] or (is_last and is_active):
                events, touched = self._events[agent_id], self._touched[agent_id]
                self.seen[agent_id] = self._make(frame, 0, agent_id, events=events, touched=touched)
                self._events[agent_id], self._touched[agent_id] = 0, []

    def reset(self, egos: Bools) -> None:
        """Begin episodes of some agents, shape (1, N)."""
        for agent_id in self._agent_ids:
            if egos[0, agent_id]:
                self._events[agent_id], self._touched[agent_id] = 0, []
                self.seen.pop(agent_id, None)

    def _collect_touched(self, frame: Frame) -> None:
        for agent_id in self._agent_ids:
            names = [*self._touched[agent_id], *self._make.touched(frame, 0, agent_id)]
            self._touched[agent_id] = list(dict.fromkeys(names))
