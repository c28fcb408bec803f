"""The bubbles of B simulations with all that is known of vehicles in them, and the kernels bound to it."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Bools, Ints
from smarts.bubbles.membranes import BubbleRows, Membranes, move_bubbles, place_vehicles
from smarts.bubbles.outlines import BubbleTable, bubble_table
from smarts.bubbles.phases import Holds, end_holds, judge_holds
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import BubbleStates, PlacedBubble
from smarts.types.world import State, World


class BubbleField:
    """Arrays of B simulations with at most Z bubbles, V vehicle slots and A agents.

    A scenario's bubbles join the table when an episode first needs them; room is made for the most that a
    scenario has.

    Args:
        world: The state; `agents.release_step` is written.
    """

    def __init__(self, world: World) -> None:
        worlds, agents = world.agents.slot.shape
        self._world = world
        self._known: list[tuple[PlacedBubble, ...]] = []
        self.bubbles: list[tuple[PlacedBubble, ...]] = [()] * worlds
        """The bubbles of each simulation's present episode."""
        self.holds = Holds.allocate(worlds, agents)
        """The vehicles that agents hold in bubbles."""
        self.found, self.wishes = np.zeros(worlds, np.int32), np.zeros(worlds, np.int32)
        self.rows, self.membranes, self.states = self._allocate(0)

    def begin(self, row: int, bubbles: tuple[PlacedBubble, ...]) -> None:
        """Begin an episode of one simulation; bubbles that follow a vehicle or have a condition rest."""
        self.bubbles[row] = bubbles
        if bubbles and not any(bubbles is each for each in self._known):
            self._add(bubbles)
        sizes = [len(each) for each in self._known]
        number = next((number for number, each in enumerate(self._known) if each is bubbles), 0)
        self.rows.first[row], self.rows.size[row] = sum(sizes[:number]), len(bubbles)
        self.rows.followed[row] = UNSET
        self.rows.was_there[row] = False
        self.membranes.generation[row] = UNSET
        self.membranes.is_candidate[row] = False
        self.states.clear(row)
        for place, bubble in enumerate(bubbles):
            self.states.is_active[row, place] = not bubble.followed and bubble.active_condition is None
        self.holds.clear(row)
        self.found[row] = self.wishes[row] = 0

    def end_holds(self, env_mask: Bools) -> None:
        """Forget the holds of agents that have given up their vehicles."""
        self._end_holds(env_mask)

    def update(self, env_mask: Bools) -> bool:
        """Move the bubbles, find the vehicles in them, and write which of those may change hands.

        Returns:
            Whether any may.
        """
        return self._update(env_mask) > 0

    def _add(self, bubbles: tuple[PlacedBubble, ...]) -> None:
        """Add the bubbles of a scenario, make room for them, and bind the kernels."""
        self._known.append(bubbles)
        made = self._allocate(max(map(len, self._known)))
        for old, new in zip((self.rows, self.membranes, self.states), made, strict=True):
            for before, column in zip(old, new, strict=True):
                column[tuple(map(slice, before.shape))] = before
        self.rows, self.membranes, self.states = made
        table, state = bubble_table(bubble for known in self._known for bubble in known), self._world.state
        self._end_holds = bind(end_holds, state, self.holds, self.membranes)
        self._update = bind(update_bubbles, state, table, *made, self.holds, self.found, self.wishes)

    def _allocate(self, most: int) -> tuple[BubbleRows, Membranes, BubbleStates]:
        """Return arrays for at most so many bubbles in a simulation."""
        worlds, capacity = self._world.vehicles.alive.shape
        rows, membranes = BubbleRows.allocate(worlds, most), Membranes.allocate(worlds, most, capacity)
        return rows, membranes, BubbleStates.allocate(worlds, most)


@kernel
def update_bubbles(
    state: State,
    table: BubbleTable,
    rows: BubbleRows,
    membranes: Membranes,
    states: BubbleStates,
    holds: Holds,
    found: Ints,
    wishes: Ints,
    env_mask: Bools,
) -> int:
    """Do all of `BubbleField.update`; return how many vehicles may change hands."""
    move_bubbles(state, table, rows, states, env_mask)
    end_holds(state, holds, membranes, env_mask)
    place_vehicles(state, table, rows, membranes, states, env_mask, found)
    judge_holds(state, table, rows, membranes, states, holds, env_mask, wishes)
    total = 0
    for b in range(len(env_mask)):
        if env_mask[b]:
            total += found[b] + wishes[b]
    return total
