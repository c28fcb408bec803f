"""Who is in the world: the only place where vehicles get their identity."""

from __future__ import annotations

import numpy as np

from smarts.errors import TrafficError
from smarts.types.vehicles import Owner, VehicleKind, VehicleStates


class Roster:
    """Issues slots of one simulation; (slot, generation) and the public name hold for a vehicle's whole life.

    A change of owner does not touch identity. A vehicle takes the lowest free slot, so the world is the same
    whenever the same vehicles come and go in the same order, and a busy world stays dense at the front of its
    arrays. Egos enter before traffic does and so get the first slots, but nothing relies on that: a seat says
    which slot an agent drives.

    Args:
        states: The slots, shape (V,); the roster writes who is there, the providers write how it moves.
    """

    def __init__(self, states: VehicleStates) -> None:
        self.states = states
        self._names: list[str] = [""] * states.capacity
        self._taken: set[str] = set()

    def reset(self) -> None:
        """Empty the world, and begin to count generations and names anew."""
        for slot in np.flatnonzero(self.states.alive):
            self.dismiss(int(slot))
        self.states.generation[:] = 0
        self._taken.clear()

    def admit(self, name: str, owner: int, kind: VehicleKind, length: float, width: float) -> int:
        """Let a vehicle in and return its slot.

        Args:
            name: Public name, made unique by a number after "~" if an earlier vehicle of the episode had it.
            owner: Who moves it; unless that is an agent, it is also where the vehicle is at home.
            kind: What it is.
            length: Of the footprint [m].
            width: Of the footprint [m].

        Raises:
            TrafficError: No slot is free.
        """
        states = self.states
        slot = int(states.alive.argmin())
        if states.alive[slot]:
            raise TrafficError(
                f"all {states.capacity} slots of the world are taken",
                remedy="raise the scenario's limit of vehicles",
            )
        states.alive[slot] = True
        states.generation[slot] += 1
        states.owner[slot] = owner
        states.home[slot] = Owner.NOBODY if owner == Owner.AGENT else owner
        states.kind[slot] = kind
        states.length[slot] = length
        states.width[slot] = width
        self._names[slot] = self._unique(name)
        return slot

    def dismiss(self, slot: int) -> None:
        """Take a vehicle out of the world and clear its row, except for the generation."""
        self.states.clear(slot)
        self._names[slot] = ""

    def name(self, slot: int) -> str:
        """Return the public name of the vehicle in a slot, "" if it is free."""
        return self._names[slot]

    def _unique(self, name: str) -> str:
        unique, number = name, 1
        while unique in self._taken:
            number += 1
            unique = f"{name}~{number}"
        self._taken.add(unique)
        return unique
