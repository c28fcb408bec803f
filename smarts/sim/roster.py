"""Who is in the world: the only place where vehicles get their identity."""

from __future__ import annotations

import dataclasses

import numpy as np

from smarts.errors import TrafficError
from smarts.types.vehicles import Owner, VehicleKind, VehicleStates


class Roster:
    """Issues slots of one simulation; (slot, generation) and the public name hold for a vehicle's whole life.

    A change of owner does not touch identity. Vehicles that name no slot take the lowest free one from
    `reserved` on, so the world is the same whenever the same vehicles come and go in the same order, and a
    busy world stays dense at the front of its arrays.

    Args:
        states: The slots, shape (V,); the roster writes who is there, the providers write how it moves.
        reserved: Slots at the front that are only given to those who name them: the egos'.
    """

    def __init__(self, states: VehicleStates, reserved: int = 0) -> None:
        if not 0 <= reserved <= states.capacity:
            raise ValueError(f"{reserved} slots to reserve out of {states.capacity}")
        self.states = states
        self.reserved = reserved
        self._names: list[str] = [""] * states.capacity
        self._taken: set[str] = set()
        columns = {field.name: getattr(states, field.name) for field in dataclasses.fields(states)}
        self._cleared = [column for name, column in columns.items() if name != "generation"]

    def reset(self) -> None:
        """Empty the world, and begin to count generations and names anew."""
        for slot in np.flatnonzero(self.states.alive):
            self.dismiss(int(slot))
        self.states.generation[:] = 0
        self._taken.clear()

    def admit(
        self,
        name: str,
        owner: Owner,
        kind: VehicleKind,
        length: float,
        width: float,
        *,
        slot: int | None = None,
    ) -> int:
        """Let a vehicle in and return its slot.

        Args:
            name: Public name, made unique by a number after "~" if an earlier vehicle of the episode had it.
            owner: Who moves it.
            kind: What it is.
            length: Of the footprint [m].
            width: Of the footprint [m].
            slot: The slot to take, which must be free; by default the lowest free one that is not reserved.

        Raises:
            TrafficError: No slot is free.
        """
        if slot is None:
            slot = self._lowest_free()
        elif self.states.alive[slot]:
            raise ValueError(f"slot {slot} is taken by '{self._names[slot]}'")
        states = self.states
        states.alive[slot] = True
        states.generation[slot] += 1
        states.owner[slot] = owner
        states.kind[slot] = kind
        states.length[slot] = length
        states.width[slot] = width
        self._names[slot] = self._unique(name)
        return slot

    def dismiss(self, slot: int) -> None:
        """Take a vehicle out of the world and clear its row, except for the generation."""
        for column in self._cleared:
            column[slot] = 0
        self.states.lane[slot] = -1
        self._names[slot] = ""

    def name(self, slot: int) -> str:
        """Return the public name of the vehicle in a slot, "" if it is free."""
        return self._names[slot]

    def _lowest_free(self) -> int:
        free = ~self.states.alive[self.reserved :]
        if not free.any():
            raise TrafficError(
                f"all {self.states.capacity} slots of the world are taken ({self.reserved} are the egos')",
                remedy="raise the capacity of the simulation",
            )
        return self.reserved + int(free.argmax())

    def _unique(self, name: str) -> str:
        unique, number = name, 1
        while unique in self._taken:
            number += 1
            unique = f"{name}~{number}"
        self._taken.add(unique)
        return unique
