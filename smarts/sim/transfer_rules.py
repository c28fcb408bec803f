"""Which vehicles change hands: agents that end give theirs up, agents that wait for one take it over."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.geometry.binding import bind
from smarts.geometry.segments import inside_outline
from smarts.sim.agent_pool import AgentPool
from smarts.sim.entries import Entries
from smarts.sim.leaving import find_leavers
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart, TakeOver
from smarts.types.events import Events, Outcome
from smarts.types.transfers import Departure, Reason, Refusal, Transfer
from smarts.types.vehicles import STANDING, Owner
from smarts.types.world import World

OFF_LANES_TIME = 5.0
"""A vehicle that stands beside all lanes is removed after this time, or after its `collision_time` [s]."""
AT_END = 2.0
"""Distance of a vehicle's front to the end of a lane that leads nowhere, to have arrived [m]."""


class HandoverRules:
    """Proposes transfers: vehicles of agents that end go, agents that wait for a vehicle get one.

    A vehicle that came with its agent is removed when the agent is done. A vehicle that came from traffic
    goes back to it (RELEASE), as soon as the traffic engine's gate lets it, proposed in every step until
    then: if its agent is DONE or LEAVING, or ACTIVE with a `release_step`. It is removed only where it cannot
    go back: after a collision, once it has stood for the `collision_time` of its agent's start; beside all
    lanes; or at the end of a lane that leads nowhere.

    Args:
        world: The state; read.
        entries: Knows which agents wait.
        pool: Knows the episode's agents.
        can_take: `Ownership.can_take`.
    """

    def __init__(
        self, world: World, entries: Entries, pool: AgentPool, can_take: Callable[[Ints, Ints], Bytes]
    ) -> None:
        self._world, self._entries, self._pool = world, entries, pool
        self._can_take = can_take
        self._leavers = np.zeros((world.agents.slot.size, 2), np.int32)
        self._find_leavers = bind(find_leavers, world.state, self._leavers)
        # What the triggers of conditions remember, by simulation and number of the agent.
        self._memory = [defaultdict[int, dict[Any, float]](dict) for _ in range(world.worlds)]

    def clear(self, row: int) -> None:
        """Forget what the conditions of one simulation's agents remember."""
        self._memory[row].clear()

    def propose(self, events: Events, env_mask: Bools) -> list[Transfer]:
        """Return the transfers for the beginning of the next step."""
        proposed = [*self._leaves(env_mask)]
        if any(self._entries.waiting):
            for row in np.flatnonzero(env_mask).tolist():
                proposed += self._takes(row)
        return proposed

    def _leaves(self, env_mask: Bools) -> Iterator[Transfer]:
        """Yield the transfers of vehicles that their agents give up, home or out of the world."""
        agents, vehicles = self._world.agents, self._world.vehicles
        for row, agent_id in self._leavers[: self._find_leavers(env_mask)].tolist():
            slot, generation = int(agents.slot[row, agent_id]), int(agents.generation[row, agent_id])
            owner, home = int(vehicles.owner[row, slot]), int(vehicles.home[row, slot])
            seen = row, slot, generation, owner, agent_id
            departure = Departure.NONE if owner == home else self._departure(row, agent_id, slot, home)
            if departure != Departure.NONE:
                yield Transfer(*seen, Owner.NOBODY, UNSET, Reason.LEAVE, departure=departure)
            elif not self._is_harmed(row, agent_id):
                yield Transfer(*seen, home, UNSET, Reason.RELEASE)

    def _is_harmed(self, row: int, agent_id: int) -> bool:
        """Return whether an agent's vehicle has collided."""
        agents = self._world.agents
        is_done = agents.state[row, agent_id] == AgentStatus.DONE
        return bool(
            agents.outcome[row, agent_id] == Outcome.COLLISION if is_done else agents.harmed[row, agent_id]
        )

    def _departure(self, row: int, agent_id: int, slot: int, home: int) -> int:
        """Return why a vehicle is to leave the simulation, NONE if it is to go back to its home."""
        world, agents = self._world, self._world.agents
        if home == Owner.NOBODY:
            return Departure.OWN
        start = self._pool.start(row, agent_id)
        stays = start.collision_time if start else 0.0
        is_done = agents.state[row, agent_id] == AgentStatus.DONE
        waited = 0.0 if is_done else float(world.step[row] - agents.release_step[row, agent_id]) * world.dt
        if self._is_harmed(row, agent_id):
            return Departure.COLLISION if waited >= stays - 1e-9 else Departure.NONE
        if self._is_at_end(row, slot):
            return Departure.ARRIVED
        is_off = not (is_done or agents.on_road[row, agent_id] or world.vehicles.speed[row, slot] > STANDING)
        return Departure.OFF_LANES if is_off and waited >= max(stays, OFF_LANES_TIME) else Departure.NONE

    def _is_at_end(self, row: int, slot: int) -> bool:
        """Return whether a vehicle's front is at the end of a lane that leads nowhere."""
        vehicles, roads = self._world.vehicles, self._entries.roads(row)
        lane = int(vehicles.lane[row, slot])
        if lane < 0 or len(roads.successors(lane)):
            return False
        left = float(roads.length[lane] - vehicles.lane_position[row, slot] - vehicles.length[row, slot] / 2)
        return left <= AT_END

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


def _suits(world: World, row: int, slot: int, rule: TakeOver) -> bool:
    """Return whether the rule is for this vehicle, and for where its front is."""
    name, vehicles = world.registry.name(row, slot), world.vehicles
    if rule.vehicle not in ("", name) or name.startswith(rule.spared or ("\0",)):
        return False
    heading, half = float(vehicles.heading[row, slot]), float(vehicles.length[row, slot]) / 2
    x, y = vehicles.position[row, slot].tolist()
    x, y = x + half * np.cos(heading), y + half * np.sin(heading)
    return not rule.areas or any(inside_outline(x, y, area, 0, len(area)) for area in rule.areas)


def _distance(world: World, row: int, slot: int, start: AgentStart) -> float:
    """Return how far a vehicle is from an agent's start [m]."""
    x, y = world.vehicles.position[row, slot].tolist()
    return float(np.hypot(x - start.pose[0], y - start.pose[1]))
