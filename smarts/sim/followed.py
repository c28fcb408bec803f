"""The vehicles that bubbles travel with, found by the name of an agent or a vehicle."""

from __future__ import annotations

import numpy as np

from smarts.sim.agent_pool import AgentPool
from smarts.types.agent_states import UNSET
from smarts.types.world import World


class Followed:
    """Finds vehicles by name; a search through all vehicles is made only when one has appeared.

    Args:
        world: The state; read.
        pool: Knows the agents' names.
    """

    def __init__(self, world: World, pool: AgentPool) -> None:
        self._world, self._pool = world, pool
        self._numbers: list[dict[str, int]] = [{} for _ in range(world.worlds)]
        """Numbers of the agents of each simulation, by name."""
        self._found: list[dict[str, tuple[int, int]]] = [{} for _ in range(world.worlds)]
        """Slot and generation of vehicles, by name."""
        self._searched: list[dict[str, int]] = [{} for _ in range(world.worlds)]
        """How many vehicles there had been when each name was searched last."""

    def clear(self, row: int) -> None:
        """Forget the episode of one simulation."""
        for known in (self._numbers, self._found, self._searched):
            known[row].clear()

    def slot(self, row: int, name: str) -> int:
        """Return the slot of the vehicle of an agent, or else of a vehicle, of this name; -1 without one."""
        numbers, starts = self._numbers[row], self._pool.starts[row]
        for number in range(len(numbers), len(starts)):
            numbers[starts[number].name] = number
        column = self._pool.column(row, numbers[name]) if name in numbers else UNSET
        held = int(self._world.agents.slot[row, column]) if column != UNSET else UNSET
        return held if held != UNSET else self.vehicle(row, name)

    def vehicle(self, row: int, name: str) -> int:
        """Return the slot of the vehicle of this name; -1 without one."""
        world, vehicles = self._world, self._world.vehicles
        slot, generation = self._found[row].get(name, (UNSET, UNSET))
        if slot != UNSET and vehicles.alive[row, slot] and vehicles.generation[row, slot] == generation:
            return slot
        issued = int(vehicles.generation[row].sum())
        if self._searched[row].get(name) == issued:
            return UNSET
        self._searched[row][name] = issued
        for slot in np.flatnonzero(vehicles.alive[row]).tolist():
            if world.registry.name(row, slot) == name:
                self._found[row][name] = slot, int(vehicles.generation[row, slot])
                return slot
        return UNSET
