"""The pool: agents of each episode, and the columns of `AgentStates` that are handed out to them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.arrays import Ints
from smarts.roads.agent_routes import AgentRoutes
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.frame import Readings
from smarts.types.world import World


class Hold(NamedTuple):
    """One agent's time in a column."""

    number: int
    """Number of the agent in its episode."""
    agent_id: int
    """The column."""
    step: int
    """First step of the episode in which the agent has the column."""


class AgentPool:
    """The agents of each simulation's episode, and which column each of them holds.

    Agents have a number in their episode: first those of `EpisodeStart.agents`, then those that `announce`
    adds. Egos have fixed columns, 0 to E - 1. A further agent gets a column when it enters, of those of its
    interface the lowest that is free, and has it until it has given up its vehicle. Columns of an interface
    are contiguous; `columns` says which. If none is free the agent does not enter.

    A column that is handed out is cleared: no agent sees what the one before it left. Parts that keep arrays
    of agents register them by `clear_with`; parts that keep other things keep them by the agent's number, or
    by `serial`.

    Args:
        world: The state; agents and missions are written.
        routes: The agents' routes; written.
        interfaces: Interfaces of the further agents, all different.
        capacities: Columns for each of them; they follow those of the egos.
    """

    def __init__(
        self,
        world: World,
        routes: AgentRoutes,
        interfaces: Sequence[AgentInterface] = (),
        capacities: Sequence[int] = (),
    ) -> None:
        worlds, agents = world.agents.slot.shape
        self._world, self._routes = world, routes
        self.busy = np.zeros((worlds, world.egos), np.bool_)
        """Columns of egos that have ended in a decision that has not been returned yet: they are not handed
        out, since their last observation is still to be read."""
        self.interfaces = tuple(interfaces)
        """The interfaces of further agents, by number."""
        ends = world.egos + np.cumsum([0, *capacities])
        self._columns = tuple(slice(*pair) for pair in zip(ends.tolist(), ends[1:].tolist(), strict=False))
        self.interface_id: Ints = np.full(agents, UNSET, np.int32)
        """Number of each column's interface, -1 for egos, shape (A,)."""
        for number, columns in enumerate(self._columns):
            self.interface_id[columns] = number
        self.serial = np.zeros((worlds, agents), np.int64)
        """Number of each column's hold among all of its simulation, episodes before included; 0: none yet."""
        self.starts: list[list[AgentStart]] = [[] for _ in range(worlds)]
        """All agents of each simulation's episode, by number."""
        self.holds: list[list[Hold]] = [[] for _ in range(worlds)]
        """The holds of each simulation's episode, in order."""
        self.policy: Ints = np.full((worlds, agents), UNSET, np.int32)
        """Number of the social policy that acts for each column's agent, -1 for none, shape (B, A)."""
        self.episodes: list[EpisodeStart | None] = [None] * worlds
        """The episode of each simulation."""
        self._names: list[set[str]] = [set() for _ in range(worlds)]
        self._column_of: list[dict[int, int]] = [{} for _ in range(worlds)]
        # Of each array that is cleared with a hold: the value of each column of a fresh agent, by its place
        # on the second axis, and the place of each agent_id there, -1 for none.
        self._cleared: list[tuple[NDArray, list[Any], list[int]]] = []
        state = world.state
        # `_hold` writes the whole mission.
        self.clear_with((*state.agents, *state.guidance))

    def columns(self, interface: int) -> slice:
        """Return the columns of the agents of an interface, given by its number."""
        return self._columns[interface]

    def clear_with(self, arrays: Iterable[NDArray], agent_ids: Ints | None = None) -> None:
        """Clear further arrays whenever a column is handed out, to the values that they have now.

        Args:
            arrays: Shape (B, A, ...), or (B, G, ...) for some agents; a column's values are equal now.
            agent_ids: Those agents, shape (G,).
        """
        agents = len(self.interface_id)
        held = np.arange(agents) if agent_ids is None else agent_ids
        place = np.full(agents, UNSET, np.int32)
        place[held] = np.arange(len(held))
        for array in arrays:
            if array.size:
                empty = array[0].reshape(len(held), -1)[:, 0].tolist()
                self._cleared.append((array, empty, place.tolist()))

    def clear_readings_with(self, readings: Readings) -> None:
        """Clear sensors' readings, too, whenever a column is handed out."""
        for name, block in readings.blocks.items():
            self.clear_with(block.values(), readings.agent_ids[name])

    def begin(self, row: int, start: EpisodeStart) -> None:
        """Begin an episode in an empty simulation: its agents get their numbers, the egos their columns."""
        egos = [agent for agent in start.agents if agent.interface == UNSET]
        self.episodes[row] = start
        self.starts[row], self._names[row] = [*start.agents], {agent.name for agent in start.agents}
        self.policy[row] = UNSET
        self.busy[row] = False
        self.holds[row] = []
        self._column_of[row].clear()
        self._routes.assign(row, start.map, [agent.mission.route for agent in egos])
        for number in range(len(egos)):
            self._hold(row, number, number)

    def announce(self, row: int, start: AgentStart) -> int:
        """Add an agent to the episode that a simulation plays; return its number.

        The agent gets a column with its vehicle: by a transfer that has its number. Its name is made unique
        by a number after "~" if another agent of the episode has it.
        """
        name, count = start.name, 1
        while name in self._names[row]:
            count += 1
            name = f"{start.name}~{count}"
        self._names[row].add(name)
        self.starts[row].append(replace(start, name=name))
        return len(self.starts[row]) - 1

    def renew(self, row: int, number: int, start: AgentStart) -> None:
        """Replace the start of an agent that has been announced and has had no column yet; its name stays."""
        if number not in self._column_of[row]:
            self.starts[row][number] = replace(start, name=self.starts[row][number].name)

    def take(self, row: int, number: int) -> int:
        """Hand out a column to an agent of the episode; return it, -1 if all of its interface are held.

        The column is cleared, gets the agent's mission, and is WAITING for a vehicle. An agent gets one only
        once.
        """
        if number in self._column_of[row]:
            return UNSET
        agents, start = self._world.agents, self.starts[row][number]
        columns = self._open_columns(row, start.interface)
        is_free = (agents.state[row, columns] == AgentStatus.VACANT) & (agents.slot[row, columns] == UNSET)
        if start.interface == UNSET:
            is_free &= ~self.busy[row]
        if not is_free.any():
            return UNSET
        agent_id = columns.start + int(is_free.argmax())
        for array, empty, place in self._cleared:
            if (here := place[agent_id]) != UNSET:
                array[row, here] = empty[here]
        self._routes.assign_agent(row, agent_id, start.mission.route)
        self._hold(row, number, agent_id)
        return agent_id

    def column(self, row: int, number: int) -> int:
        """Return the column of an agent of the episode, -1 without one; it keeps its last until reused."""
        agent_id = self._column_of[row].get(number, UNSET)
        is_held = agent_id != UNSET and self._world.agents.agent[row, agent_id] == number
        return agent_id if is_held else UNSET

    def start(self, row: int, agent_id: int) -> AgentStart | None:
        """Return the start of the agent that holds a column, or has held it last; None without one."""
        number = int(self._world.agents.agent[row, agent_id])
        return self.starts[row][number] if number != UNSET else None

    def name(self, row: int, agent_id: int) -> str:
        """Return the name of the agent that holds a column, or has held it last; "" without one."""
        start = self.start(row, agent_id)
        return start.name if start else ""

    def _open_columns(self, row: int, interface: int) -> slice:
        """Return the columns of an interface that an episode may use; of -1, the egos'."""
        if interface == UNSET:
            return slice(0, self._world.egos)
        columns, episode = self._columns[interface], self.episodes[row]
        room = None if episode is None else episode.room
        if room is None or interface >= len(room):
            return columns
        return slice(columns.start, min(columns.stop, columns.start + room[interface]))

    def _hold(self, row: int, number: int, agent_id: int) -> None:
        """Let an agent hold a column, which is clear."""
        world, start = self._world, self.starts[row][number]
        mission = start.mission
        roads = self._routes.atlas.graphs[world.map[row]]
        world.missions.write(
            row, agent_id, mission, world.routes.number(row, map(roads.edge_number, mission.route))
        )
        world.agents.agent[row, agent_id] = number
        world.agents.state[row, agent_id] = AgentStatus.WAITING
        world.agents.period[row, agent_id] = start.period
        self.policy[row, agent_id] = start.policy
        self.serial[row, agent_id] = self.serial[row].max() + 1
        self.holds[row].append(Hold(number, agent_id, int(world.step[row])))
        self._column_of[row][number] = agent_id
