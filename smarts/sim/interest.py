"""Vehicles of interest: an agent may end when they are gone."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from smarts.agents.criteria import InterestDoneCriteria
from smarts.agents.interface import AgentInterface
from smarts.arrays import Bools
from smarts.sim.entries import Entries
from smarts.sim.schedule import Schedule
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.world import World


class NamedInterest:
    """Finds by their names the vehicles of interest to each agent.

    Args:
        world: What is read.
        criteria: Criteria of each column; None for agents without vehicles of interest.
        marked: The pattern of the names that each scenario marks, by the scenario's name; "" for none.
        entries: Knows which scenarios are played.
    """

    def __init__(
        self,
        world: World,
        criteria: Sequence[InterestDoneCriteria | None],
        marked: Mapping[str, str],
        entries: Entries,
    ) -> None:
        shape = len(entries.episodes), len(criteria)
        self._criteria = {agent_id: each for agent_id, each in enumerate(criteria) if each is not None}
        self._marked = marked
        self._world, self._entries = world, entries
        # Number of the agent for which each column has seen a vehicle of interest.
        self._seen_by = np.full(shape, UNSET, np.int32)
        self._gone = np.zeros(shape, np.bool_)

    def is_gone(self, env_mask: Bools) -> Bools:
        """Return for which agents no vehicle of interest is left, shape (B, A)."""
        world = self._world
        self._gone[:] = False
        self._seen_by[env_mask & (world.step <= 1)] = UNSET
        for row in np.flatnonzero(env_mask).tolist():
            slots = np.flatnonzero(world.vehicles.alive[row]).tolist()
            names = {slot: world.registry.name(row, slot) for slot in slots}
            for agent_id, criteria in self._criteria.items():
                if world.agents.state[row, agent_id] not in (AgentStatus.VACANT, AgentStatus.LEAVING):
                    self._gone[row, agent_id] = self._is_gone(row, agent_id, criteria, names)
        return self._gone

    def _is_gone(
        self, row: int, agent_id: int, criteria: InterestDoneCriteria, names: Mapping[int, str]
    ) -> bool:
        """Return whether no vehicle of interest to an agent is left; `names` are those of all, by slot."""
        agents, episode = self._world.agents, self._entries.episodes[row]
        own, number = int(agents.slot[row, agent_id]), agents.agent[row, agent_id]
        marked = self._marked.get(episode.scenario, "") if episode else ""
        is_added = criteria.include_scenario_marked and marked
        patterns = (*criteria.actors_filter, *([marked] if is_added else ()))
        for slot, name in names.items():
            if slot != own and any(re.match(pattern, name) for pattern in patterns):
                self._seen_by[row, agent_id] = number
                return False
        return criteria.strict or bool(self._seen_by[row, agent_id] == number)


def interest_of(
    world: World, interfaces: Sequence[AgentInterface], schedule: Schedule, entries: Entries
) -> NamedInterest | None:
    """Return what the interfaces demand of vehicles of interest, None if nothing."""
    criteria = [interface.done_criteria.interest for interface in interfaces]
    if not any(criteria):
        return None
    return NamedInterest(world, criteria, schedule.interests, entries)
