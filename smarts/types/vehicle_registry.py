"""Vehicle registry: the only place where vehicles get their identity."""

from __future__ import annotations

import re

import numpy as np

from smarts.errors import TrafficError
from smarts.types.vehicles import Owner, VehicleStates

MADE_NAME = re.compile(r"vehicle-(\d+)-\d+")
"""Name of a vehicle that was given none, with its slot and generation."""


class VehicleRegistry:
    """Issues the vehicle slots of B simulations; (slot, generation) holds for a vehicle's whole life.

    A change of owner does not touch identity. A vehicle takes the lowest free slot of its simulation, so a
    simulation is the same whenever the same vehicles come and go in the same order, and its arrays stay dense
    at the front. Identity is in the arrays `alive`, `generation`, `owner`, `home`, `kind`, `length` and
    `width`, so a kernel may issue slots by the same rule; names are beside the arrays.

    Args:
        states: The slots, shape (B, V). The registry writes identity, the providers write motion.
    """

    def __init__(self, states: VehicleStates) -> None:
        self.states = states
        worlds = states.alive.shape[0]
        self.used = np.zeros(worlds, np.int32)
        """How many slots, the first ones, have been given in the episode, shape (B,)."""
        self._names: list[dict[int, tuple[int, str]]] = [{} for _ in range(worlds)]
        """Generation that is named, and its name, by slot."""
        self._by_name: list[dict[str, int]] = [{} for _ in range(worlds)]
        """Slot of each name of the episode that was given."""

    def reset(self, row: int) -> None:
        """Empty a simulation, and restart its generations and names."""
        self.states.clear((row, slice(None)))
        self.states.generation[row] = self.used[row] = 0
        self._names[row].clear()
        self._by_name[row].clear()

    def admit(self, row: int, name: str, owner: int, kind: int, length: float, width: float) -> int:
        """Give a vehicle a slot and return it.

        Args:
            row: The simulation.
            name: Public name, made unique by a number after "~" if an earlier vehicle of the episode had it.
            owner: Provider that moves the vehicle; unless that is an agent, it also is the vehicle's home.
            kind: A `VehicleKind`.
            length: Length of the footprint [m].
            width: Width of the footprint [m].

        Raises:
            TrafficError: No slot is free.
        """
        states = self.states
        slot = int(states.alive[row].argmin())
        if states.alive[row, slot]:
            raise TrafficError(
                f"all {states.capacity} slots of the simulation are taken",
                remedy="raise the scenario's limit of vehicles",
            )
        states.alive[row, slot] = True
        self.used[row] = max(self.used[row], slot + 1)
        states.generation[row, slot] += 1
        states.owner[row, slot] = owner
        states.home[row, slot] = Owner.NOBODY if owner == Owner.AGENT else owner
        states.kind[row, slot], states.height[row, slot] = kind, np.nan
        states.length[row, slot], states.width[row, slot] = length, width
        unique, number, by_name = name, 1, self._by_name[row]
        while unique in by_name:
            number += 1
            unique = f"{name}~{number}"
        self._names[row][slot], by_name[unique] = (int(states.generation[row, slot]), unique), slot
        return slot

    def dismiss(self, row: int, slot: int) -> None:
        """Take a vehicle out of its simulation and clear its slot, except for the generation."""
        self.states.clear((row, slot))

    def name(self, row: int, slot: int) -> str:
        """Return the public name of the vehicle in a slot, "" if the slot is free."""
        if not self.states.alive[row, slot]:
            return ""
        generation = int(self.states.generation[row, slot])
        named, name = self._names[row].get(slot, (-1, ""))
        return name if named == generation else f"vehicle-{slot}-{generation}"

    def slot(self, row: int, name: str) -> int:
        """Return the slot of the vehicle of a public name, -1 if it is not there."""
        slot = self._by_name[row].get(name, -1)
        if slot < 0 and (made := MADE_NAME.fullmatch(name)):
            slot = int(made[1])
        return slot if 0 <= slot < self.states.capacity and self.name(row, slot) == name else -1
