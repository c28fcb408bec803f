"""Agents as users write them in Python: what they see as objects, through the adapters of their specs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.env.adapters.protocol import AdapterContext
from smarts.env.observation import Observation, ObservationMaker, Parts
from smarts.types.frame import Frame

Bools = NDArray[np.bool_]


class ObservationCollector:
    """Keeps what some agents of the only simulation saw last, as objects.

    Args:
        parts: What the simulation was assembled into.
        served: The agents.
    """

    def __init__(self, parts: Parts, served: AdapterContext) -> None:
        self.seen: dict[int, Observation] = {}
        """By agent."""
        self._observe = ObservationMaker(parts)
        self._served = served
        # Since each agent last looked:
        self._events = np.zeros(len(served.agents), np.int32)
        self._touched: list[list[str]] = [[] for _ in served.agents]

    def collect(self, frame: Frame, is_last: bool) -> None:
        """See a step, and make the observations of those whose decision ends with it."""
        settle = self._served.present(frame) if is_last else self._served.ended(frame)
        self._events |= frame.events.bits[0, self._served.agent_ids]
        hit = frame.contacts.touching[0, self._served.agent_ids].any(axis=1)
        for place in np.flatnonzero(hit).tolist():
            names = self._observe.touched(frame, 0, int(self._served.agent_ids[place]))
            self._touched[place] = list(dict.fromkeys([*self._touched[place], *names]))
        for place in np.flatnonzero(settle[0]).tolist():
            agent_id, events = int(self._served.agent_ids[place]), int(self._events[place])
            self.seen[agent_id] = self._observe(
                frame, 0, agent_id, events=events, touched=self._touched[place]
            )
            self._events[place], self._touched[place] = 0, []

    def reset(self, egos: Bools) -> None:
        """Forget some agents, shape (1, N)."""
        for place, agent_id in enumerate(self._served.agent_ids.tolist()):
            if egos[0, agent_id]:
                self._events[place], self._touched[place] = 0, []
                self.seen.pop(agent_id, None)
