"""Vehicles of interest: agents may end when those that matter are gone."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from smarts.agents.criteria import InterestDoneCriteria
from smarts.agents.interface import AgentInterface
from smarts.arrays import Bools
from smarts.sim.entries import Entries
from smarts.sim.schedule import Schedule
from smarts.types.world import World


class NamedInterest:
    """Knows by their names the vehicles that matter to each agent's agent.

    Args:
        world: What is read.
        criteria: Of each agent, None for agents that end without regard to others.
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
        self._seen = np.zeros(shape, np.bool_)
        self._gone = np.zeros(shape, np.bool_)

    def is_gone(self, env_mask: Bools) -> Bools:
        """Return for which agents no vehicle of interest is left, shape (B, A)."""
        world = self._world
        self._gone[:] = False
        self._seen[env_mask & (world.step <= 1)] = False
        for row in np.flatnonzero(env_mask).tolist():
            slots = np.flatnonzero(world.vehicles.alive[row]).tolist()
            names = {slot: world.registry.name(row, slot) for slot in slots}
            for agent_id, criteria in self._criteria.items():
                own = int(world.agents.slot[row, agent_id])
                patterns = self._patterns(row, criteria)
                is_there = any(
                    slot != own and any(re.match(pattern, name) for pattern in patterns)
                    for slot, name in names.items()
                )
                self._seen[row, agent_id] |= is_there
                self._gone[row, agent_id] = not is_there and (
                    bool(self._seen[row, agent_id]) or criteria.strict
                )
        return self._gone

    def _patterns(self, row: int, criteria: InterestDoneCriteria) -> tuple[str, ...]:
        episode = self._entries.episodes[row]
        marked = self._marked.get(episode.scenario, "") if episode else ""
        return (
            (*criteria.actors_filter, marked)
            if criteria.include_scenario_marked and marked
            else (criteria.actors_filter)
        )


def interest_of(
    world: World,
    interfaces: Sequence[AgentInterface],
    schedule: Schedule,
    entries: Entries,
) -> NamedInterest | None:
    """Return what the interfaces demand of vehicles of interest, None if nothing."""
    criteria = [interface.done_criteria.interest for interface in interfaces]
    if not any(criteria):
        return None
    return NamedInterest(world, criteria, schedule.interests, entries)
