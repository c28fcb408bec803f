"""Which vehicles are to change hands: agents that are done let go, agents that wait take over."""

from __future__ import annotations

from collections.abc import Callable, MutableMapping
from functools import partial
from typing import Any

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.geometry.segments import inside_outline
from smarts.sim.entries import Entries
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart, TakeOver
from smarts.types.events import Events, Outcome
from smarts.types.transfers import NO_TRANSFERS, Reason, Refusal, Transfers, transfers
from smarts.types.vehicles import Owner
from smarts.types.world import World

Row = tuple[int, int, int, int, int, int, int, int]

UNHARMED = (Outcome.GOAL, Outcome.TIME_OUT, Outcome.NOT_MOVING, Outcome.OTHER, Outcome.MISSED_GOAL)
"""After these, a vehicle that comes from traffic goes back to it; after the others it leaves the world."""


class HandoverRules:
    """Lets the vehicles of agents that are done go, and finds vehicles for agents that wait for one.

    Args:
        world: What is read.
        entries: Knows which agents wait.
        can_take: `can_accept` of the provider of agents' vehicles.
    """

    def __init__(self, world: World, entries: Entries, can_take: Callable[[Ints, Ints], Bytes]) -> None:
        self._world, self._entries = world, entries
        self._can_take = can_take
        # Simulations in which a vehicle may be left that no provider accepted.
        self._unsettled: set[int] = set()
        # What the triggers of conditions remember, by simulation and agent, of the episode that it is for.
        self._memory: dict[tuple[int, int], tuple[int, MutableMapping[Any, float]]] = {}

    def propose(self, events: Events, env_mask: Bools) -> Transfers:
        """Return the transfers for the beginning of the next step."""
        if not (self._unsettled or self._entries.pending or np.count_nonzero(events.just_done)):
            return NO_TRANSFERS
        world, state = self._world, self._world.agents.state
        concerned = ((state == AgentStatus.DONE) | (state == AgentStatus.WAITING)) & env_mask[:, None]
        proposed: list[Row] = []
        taken: set[tuple[int, int]] = set()
        for row, agent_id in np.argwhere(concerned).tolist():
            if state[row, agent_id] == AgentStatus.DONE:
                if world.agents.slot[row, agent_id] != UNSET:
                    proposed.append(_letting_go(world, row, agent_id, bool(events.just_done[row, agent_id])))
            elif agent_id < len(self._entries.starts(row)):
                slot = self._find(row, agent_id, taken)
                if slot != UNSET:
                    taken.add((row, slot))
                    owner = int(world.vehicles.owner[row, slot])
                    generation = int(world.vehicles.generation[row, slot])
                    proposed.append((row, slot, generation, owner, UNSET, Owner.AGENT, agent_id, Reason.TAKE))
        self._unsettled = {row for row in self._unsettled if not env_mask[row]} | {
            each[0] for each in proposed
        }
        return transfers(proposed)

    def _find(self, row: int, agent_id: int, taken: set[tuple[int, int]]) -> int:
        """Return the slot of the vehicle that an agent is to take over in the next step, -1 for none."""
        world, start = self._world, self._entries.starts(row)[agent_id]
        rule, now = start.take_over, float(world.step[row]) * world.dt
        if rule is None or now < start.entry_time - 1e-9 or not self._holds(row, agent_id, rule, now):
            return UNSET
        vehicles, name = world.vehicles, partial(world.registry.name, row)
        held = set(world.agents.slot[row].tolist())
        suited = [
            slot
            for slot in np.flatnonzero(vehicles.alive[row] & (vehicles.owner[row] != Owner.AGENT)).tolist()
            if slot not in held
            and (row, slot) not in taken
            and (not rule.vehicle or name(slot) == rule.vehicle)
            and not name(slot).startswith(rule.spared or ("\0",))
            and _is_inside(world, row, slot, rule)
        ]
        if not suited:
            return UNSET
        slots = np.array(suited, np.int32)
        suited = slots[self._can_take(np.full_like(slots, row), slots) == Refusal.NONE].tolist()
        return min(suited, key=lambda slot: (_distance(world, row, slot, start), slot), default=UNSET)

    def _holds(self, row: int, agent_id: int, rule: TakeOver, now: float) -> bool:
        if rule.condition is None:
            return True
        world = self._world
        episode, memory = self._memory.get((row, agent_id), (-1, {}))
        if world.step[row] == 0 or episode != world.episode[row]:
            memory = {}
            self._memory[row, agent_id] = int(world.episode[row]), memory
        names = {
            world.registry.name(row, slot) for slot in np.flatnonzero(world.vehicles.alive[row]).tolist()
        }
        return bool(rule.condition.evaluate(memory=memory, time=now, actor_ids=names))


def _letting_go(world: World, row: int, agent_id: int, is_first: bool) -> Row:
    """Return the transfer of a vehicle whose agent is done: home if it has one that wants it, else away."""
    agents, vehicles = world.agents, world.vehicles
    slot, generation = int(agents.slot[row, agent_id]), int(agents.generation[row, agent_id])
    owner, home = int(vehicles.owner[row, slot]), int(vehicles.home[row, slot])
    # What was refused the first time is not asked for again.
    goes_home = home != Owner.NOBODY and is_first and agents.outcome[row, agent_id] in UNHARMED
    if owner == home or goes_home:
        return row, slot, generation, owner, agent_id, home, UNSET, Reason.RELEASE
    return row, slot, generation, owner, agent_id, Owner.NOBODY, UNSET, Reason.LEAVE


def _is_inside(world: World, row: int, slot: int, rule: TakeOver) -> bool:
    if not rule.areas:
        return True
    x, y = _front(world, row, slot)
    return any(inside_outline(x, y, area, 0, len(area)) for area in rule.areas)


def _front(world: World, row: int, slot: int) -> tuple[float, float]:
    heading = float(world.vehicles.heading[row, slot])
    half = float(world.vehicles.length[row, slot]) / 2
    x, y = world.vehicles.position[row, slot].tolist()
    return x + half * np.cos(heading), y + half * np.sin(heading)


def _distance(world: World, row: int, slot: int, start: AgentStart) -> float:
    x, y = world.vehicles.position[row, slot].tolist()
    return float(np.hypot(x - start.pose[0], y - start.pose[1]))
