"""Which vehicles change hands: agents that are done release theirs, agents that wait take one over."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.geometry.segments import inside_outline
from smarts.sim.agent_pool import AgentPool
from smarts.sim.entries import Entries
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart, TakeOver
from smarts.types.events import Events, Outcome
from smarts.types.transfers import NO_TRANSFERS, Reason, Refusal, Transfer, Transfers, transfers
from smarts.types.vehicles import Owner
from smarts.types.world import World

UNHARMED = (Outcome.GOAL, Outcome.TIME_OUT, Outcome.NOT_MOVING, Outcome.OTHER, Outcome.MISSED_GOAL)
"""After these, a vehicle that comes from traffic goes back to it; after the others it is removed."""


class HandoverRules:
    """Proposes transfers: vehicles of agents that are done go, agents that wait for a vehicle get one.

    Args:
        world: The state; read.
        entries: Knows which agents wait.
        pool: Knows the episode's agents.
        can_take: `can_accept` of the provider of agents' vehicles.
    """

    def __init__(
        self, world: World, entries: Entries, pool: AgentPool, can_take: Callable[[Ints, Ints], Bytes]
    ) -> None:
        self._world, self._entries, self._pool = world, entries, pool
        self._can_take = can_take
        # Simulations in which a vehicle may be left that no provider accepted.
        self._unsettled: set[int] = set()
        # What the triggers of conditions remember, by simulation and number of the agent.
        self._memory = [defaultdict[int, dict[Any, float]](dict) for _ in range(world.worlds)]

    def clear(self, row: int) -> None:
        """Forget what the conditions of one simulation's agents remember."""
        self._memory[row].clear()

    def propose(self, events: Events, env_mask: Bools) -> Transfers:
        """Return the transfers for the beginning of the next step."""
        if not (self._unsettled or any(self._entries.waiting) or np.count_nonzero(events.just_done)):
            return NO_TRANSFERS
        agents = self._world.agents
        done = (agents.state == AgentStatus.DONE) & (agents.slot != UNSET) & env_mask[:, None]
        proposed = [
            _letting_go(self._world, row, agent_id, bool(events.just_done[row, agent_id]))
            for row, agent_id in np.argwhere(done).tolist()
        ]
        for row in np.flatnonzero(env_mask).tolist():
            proposed += self._takes(row)
        self._unsettled = {row for row in self._unsettled if not env_mask[row]} | {
            each.row for each in proposed
        }
        return transfers(proposed)

    def _takes(self, row: int) -> Iterator[Transfer]:
        """Yield the transfers of vehicles to agents of one simulation that wait for one."""
        vehicles, taken = self._world.vehicles, set[int]()
        for number in self._entries.waiting[row]:
            slot = self._find(row, number, taken) if self._entries.is_waiting(row, number) else UNSET
            if slot == UNSET:
                continue
            taken.add(slot)
            column = self._pool.column(row, number)
            yield Transfer(
                row,
                slot,
                int(vehicles.generation[row, slot]),
                from_owner=int(vehicles.owner[row, slot]),
                from_agent=UNSET,
                to_owner=Owner.AGENT,
                to_agent=column,
                reason=Reason.TAKE,
                number=number if column == UNSET else UNSET,
            )

    def _find(self, row: int, number: int, taken: set[int]) -> int:
        """Return the slot of the vehicle that an agent is to take over in the next step, -1 for none."""
        world, start = self._world, self._pool.starts[row][number]
        rule, now = start.take_over, float(world.step[row]) * world.dt
        if rule is None or now < start.entry_time - 1e-9 or not self._holds(row, number, rule, now):
            return UNSET
        vehicles = world.vehicles
        held = [*taken, *world.agents.slot[row].tolist()]
        driven = np.flatnonzero(vehicles.alive[row] & (vehicles.owner[row] != Owner.AGENT))
        free = driven[~np.isin(driven, held)].tolist()
        slots = np.array([slot for slot in free if _suits(world, row, slot, rule)], np.int32)
        if not len(slots):
            return UNSET
        suited = slots[self._can_take(np.full_like(slots, row), slots) == Refusal.NONE].tolist()
        return min(suited, key=lambda slot: (_distance(world, row, slot, start), slot), default=UNSET)

    def _holds(self, row: int, number: int, rule: TakeOver, now: float) -> bool:
        if rule.condition is None:
            return True
        world = self._world
        names = {
            world.registry.name(row, slot) for slot in np.flatnonzero(world.vehicles.alive[row]).tolist()
        }
        return bool(rule.condition.evaluate(memory=self._memory[row][number], time=now, actor_ids=names))


def _letting_go(world: World, row: int, agent_id: int, is_first: bool) -> Transfer:
    """Return the transfer of a done agent's vehicle: back to its home if that may accept it, else removal."""
    agents, vehicles = world.agents, world.vehicles
    slot, generation = int(agents.slot[row, agent_id]), int(agents.generation[row, agent_id])
    owner, home = int(vehicles.owner[row, slot]), int(vehicles.home[row, slot])
    # A refused transfer is not proposed twice.
    goes_home = home != Owner.NOBODY and is_first and agents.outcome[row, agent_id] in UNHARMED
    if owner == home or goes_home:
        return Transfer(row, slot, generation, owner, agent_id, home, UNSET, Reason.RELEASE)
    return Transfer(row, slot, generation, owner, agent_id, Owner.NOBODY, UNSET, Reason.LEAVE)


def _suits(world: World, row: int, slot: int, rule: TakeOver) -> bool:
    """Return whether the rule is for this vehicle, and for where it is."""
    name = world.registry.name(row, slot)
    is_meant = not rule.vehicle or name == rule.vehicle
    return is_meant and not name.startswith(rule.spared or ("\0",)) and _is_inside(world, row, slot, rule)


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
