"""Agents as users write them in Python: what they see as objects, through the adapters of their specs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.env.adapters.protocol import Served
from smarts.env.observation import Observation, ObservationMaker, Parts
from smarts.types.frame import Frame

Bools = NDArray[np.bool_]


class Onlooker:
    """Keeps what some agents of the only simulation saw last, as objects.

    Args:
        parts: What the simulation was assembled into.
        served: The agents.
    """

    def __init__(self, parts: Parts, served: Served) -> None:
        self.seen: dict[int, Observation] = {}
        """By seat."""
        self._observe = ObservationMaker(parts)
        self._served = served
        # Since each agent last looked:
        self._events = np.zeros(len(served.agents), np.int32)
        self._touched: list[list[str]] = [[] for _ in served.agents]

    def collect(self, frame: Frame, is_last: bool) -> None:
        """See a step, and make the observations of those whose decision ends with it."""
        settle = self._served.present(frame) if is_last else self._served.ended(frame)
        self._events |= frame.events.bits[0, self._served.seats]
        hit = frame.contacts.touching[0, self._served.seats].any(axis=1)
        for place in np.flatnonzero(hit).tolist():
            names = self._observe.touched(frame, 0, int(self._served.seats[place]))
            self._touched[place] = list(dict.fromkeys([*self._touched[place], *names]))
        for place in np.flatnonzero(settle[0]).tolist():
            seat, events = int(self._served.seats[place]), int(self._events[place])
            self.seen[seat] = self._observe(frame, 0, seat, events=events, touched=self._touched[place])
            self._events[place], self._touched[place] = 0, []

    def reset(self, egos: Bools) -> None:
        """Forget some agents, shape (1, N)."""
        for place, seat in enumerate(self._served.seats.tolist()):
            if egos[0, seat]:
                self._events[place], self._touched[place] = 0, []
                self.seen.pop(seat, None)
