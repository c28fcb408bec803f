"""Ownership: assigns each vehicle to a provider and an agent; the only module that writes the owner column.

Providers follow: at the beginning of their stage they compare the owner column with its last values. So a
hand-over is a write to one row: pose and speed stay as they are, and providers exchange nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.geometry.binding import LateBound, bind
from smarts.providers.traffic_engine import KeepsVehicles
from smarts.sim.agent_pool import AgentPool
from smarts.sim.leaving import begin_leaving, drop_vanished, note_collisions
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart
from smarts.types.events import Contacts
from smarts.types.transfers import CarriedOut, Departure, Reason, Refusal, Transfer
from smarts.types.vehicles import Owner
from smarts.types.world import World


class Driver(Protocol):
    """The method of a provider that `Ownership` calls before a hand-over."""

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """Return each vehicle's `Refusal` to be taken as it is; changes nothing."""
        ...


class _Refused(NamedTuple):
    """How often a vehicle was refused to change hands."""

    steps: int
    last: int
    seen: int
    """Bit k: by `Refusal` k."""


_NEVER = _Refused(0, Refusal.NONE, 0)


class Unresolved(NamedTuple):
    """A transfer of the present episode that was refused and has not been carried out."""

    slot: int
    generation: int
    reason: int
    """A `Reason`."""
    steps: int
    """Number of its refusals."""
    last_refusal: int
    """A `Refusal`."""


def _key(transfer: Transfer) -> tuple[int, int, int]:
    """Return which vehicle a transfer is about, and why it changes hands."""
    return transfer.slot, transfer.generation, transfer.reason


class Ownership:
    """Lets vehicles in for agents, and carries out transfers, each wholly or not at all.

    Invariants of every simulation: at most one agent holds a vehicle; an agent with a slot holds a vehicle
    that is alive and of the agent's generation; a vehicle is owned by AGENT if its agent is ACTIVE or
    LEAVING, and, except for the frame in which its agent is DONE, only then.

    Args:
        world: The state; written.
        drivers: The providers by their number.
        pool: Hands out columns to agents that get theirs with a vehicle; None: transfers name no such agents.
    """

    def __init__(self, world: World, drivers: Mapping[int, Driver], pool: AgentPool | None = None) -> None:
        self._world = world
        self._drivers, self._pool = drivers, pool
        self._queue: list[Transfer] = []
        worlds = world.worlds
        self.refused: Ints = np.zeros((worlds, len(Refusal)), np.int32)
        """How many vehicles of the present episode were refused to change hands, by `Refusal`, each vehicle
        and agent once, shape (B, R)."""
        self.departed: Ints = np.zeros((worlds, len(Departure)), np.int32)
        """How many agents' vehicles have left in the present episode, by `Departure`, shape (B, D)."""
        self.carried_out: list[CarriedOut] = []
        """What the last call of `apply` has carried out."""
        self._refused: list[dict[tuple[int, int, int], _Refused]] = [{} for _ in range(worlds)]
        self._begin_leaving = bind(begin_leaving, world.state)
        self.drop_vanished: Callable[[Bools], None] = bind(drop_vanished, world.state)
        """Vacates the columns of agents whose vehicle traffic has removed; takes `env_mask`."""
        self._note_collisions = LateBound(note_collisions, world.state)

    def clear(self, row: int) -> None:
        """Forget the transfers that are pending in one simulation, and its counts."""
        self._queue = [each for each in self._queue if each.row != row]
        self.refused[row] = self.departed[row] = 0
        self._refused[row].clear()

    def unresolved(self, row: int) -> list[Unresolved]:
        """Return the refused transfers of a simulation's present episode that have not been carried out."""
        return [Unresolved(*key, each.steps, each.last) for key, each in self._refused[row].items()]

    def note_collisions(self, contacts: Contacts, env_mask: Bools) -> None:
        """Mark the vehicles of leaving agents that have collided in this step."""
        self._note_collisions.to(contacts)(env_mask)

    def admit(self, row: int, agent_id: int, start: AgentStart) -> int:
        """Put an agent's vehicle into the world at its start, and return the slot.

        Raises:
            TrafficError: No slot is free.
        """
        slot = self._world.registry.admit(row, start.name, Owner.AGENT, start.kind, start.length, start.width)
        vehicles = self._world.vehicles
        x, y, vehicles.heading[row, slot] = start.pose
        vehicles.position[row, slot] = x, y
        vehicles.height[row, slot] = start.height
        vehicles.speed[row, slot] = start.speed
        vehicles.route[row, slot] = self._world.missions.route[row, agent_id]
        self._give(row, agent_id, slot, AgentStatus.ACTIVE)
        return slot

    def can_take(self, rows: Ints, slots: Ints) -> Bytes:
        """Return why agents cannot take over vehicles now, as a `Refusal`, shape (N,)."""
        answers = np.array(self._drivers[Owner.AGENT].can_accept(rows, slots), np.int8)
        self._ask_to_release(answers, rows, slots)
        return answers

    def submit(self, transfers: Iterable[Transfer]) -> None:
        """Put transfers in the queue; they happen when their simulation makes its next step."""
        self._queue += transfers

    def apply(self, env_mask: Bools, fresh: Bools | None = None) -> Sequence[Transfer]:
        """Carry out the pending transfers of some simulations; return those that were refused.

        The fallback controller then drives the vehicles of agents that are done and still hold one.

        They are tried in the order of `Reason`, then by agent, by number, and by slot, whatever the order in
        which they were proposed. A transfer is refused, and changes nothing, if its vehicle is gone or no
        longer with the owner and the agent that the proposer saw, if the agent that is to get it has a
        vehicle, if all columns of that agent's interface are held, if a social agent that is to drive has
        not just acted, or if the new owner does not accept it. `refused` counts why.

        Args:
            env_mask: The simulations, shape (B,).
            fresh: Which agents have just acted (`Actions.fresh`), shape (B, A); None: all.
        """
        self.carried_out = []
        refused = self._apply_pending(env_mask, fresh) if self._queue else ()
        self._begin_leaving(env_mask)
        return refused

    def _apply_pending(self, env_mask: Bools, fresh: Bools | None) -> Sequence[Transfer]:
        pending = [each for each in self._queue if env_mask[each.row]]
        self._queue = [each for each in self._queue if not env_mask[each.row]]
        pending.sort(key=lambda each: (each.row, each.reason, each.to_agent, each.number, each.slot))
        refused = []
        for transfer, answer in zip(pending, self._answers(pending, fresh).tolist(), strict=True):
            refusal = self._carry_out(transfer) if answer == Refusal.NONE else answer
            if refusal != Refusal.NONE:
                self._count(transfer, refusal)
                refused.append(transfer)
                continue
            before = self._refused[transfer.row].pop(_key(transfer), _NEVER)
            self.carried_out.append(CarriedOut(transfer, before.steps, before.last))
        return refused

    def _count(self, transfer: Transfer, refusal: int) -> None:
        """Count a refusal."""
        refused = self._refused[transfer.row]
        before = refused.get(_key(transfer), _NEVER)
        if not before.seen >> refusal & 1:
            self.refused[transfer.row, refusal] += 1
        refused[_key(transfer)] = _Refused(before.steps + 1, refusal, before.seen | 1 << refusal)

    def _answers(self, pending: Sequence[Transfer], fresh: Bools | None) -> Bytes:
        """Return the gates' answers to transfers, shape (T,); each new owner is asked once."""
        answers = np.full(len(pending), Refusal.NONE, np.int8)
        columns = [(each.row, each.slot, each.from_owner, each.to_owner) for each in pending]
        rows, slots, before, after = np.array(columns, np.int32).reshape(-1, 4).T
        for owner, driver in self._drivers.items():
            asked = (before != after) & (after == owner)
            if asked.any():
                answers[asked] = driver.can_accept(rows[asked], slots[asked])
        taken = np.flatnonzero((before != after) & (after == Owner.AGENT))
        if len(taken):
            answers_of_taken = answers[taken]
            self._ask_to_release(answers_of_taken, rows[taken], slots[taken])
            answers[taken] = answers_of_taken
        if fresh is not None and self._pool is not None:
            for place, (row, *_, agent_id, reason, _, _) in enumerate(pending):
                if reason != Reason.TAKE or answers[place] != Refusal.NONE:
                    continue
                start = self._pool.start(row, agent_id) if agent_id != UNSET else None
                if start is not None and start.policy >= 0 and not fresh[row, agent_id]:
                    answers[place] = Refusal.NO_ACTION
        return answers

    def _ask_to_release(self, answers: Bytes, rows: Ints, slots: Ints) -> None:
        """Write the refusals of the drivers to release vehicles that nothing else has refused."""
        owner = self._world.vehicles.owner[rows, slots]
        for number, driver in self._drivers.items():
            asked = (answers == Refusal.NONE) & (owner == number)
            if isinstance(driver, KeepsVehicles) and asked.any():
                answers[asked] = driver.can_release(rows[asked], slots[asked])

    def _carry_out(self, transfer: Transfer) -> int:
        """Carry out a transfer if nothing forbids it; return the `Refusal`, NONE if it was carried out."""
        if not (self._is_as_seen(transfer) and self._can_go(transfer)):
            return Refusal.STALE
        row, slot, _, _, from_agent, owner, to_agent, _, number, departure = transfer
        if self._pool and number != UNSET:
            to_agent = self._pool.take(row, number)
            if to_agent == UNSET:
                return Refusal.FULL
        if from_agent not in (UNSET, to_agent):
            self._release(row, from_agent)
        if owner == Owner.NOBODY:
            self._world.registry.dismiss(row, slot)
            self.departed[row, departure] += 1
        else:
            self._assign(row, slot, owner, to_agent)
        return Refusal.NONE

    def _assign(self, row: int, slot: int, owner: int, agent_id: int) -> None:
        """Write a vehicle's new owner, and give it to an agent unless that is -1."""
        vehicles = self._world.vehicles
        if owner != vehicles.owner[row, slot]:
            vehicles.owner[row, slot] = owner
            # The new owner plans its own route.
            vehicles.route[row, slot] = UNSET
        if agent_id != UNSET:
            state = AgentStatus.ACTIVE if owner == Owner.AGENT else AgentStatus.SHADOWING
            self._give(row, agent_id, slot, state)
            if owner == Owner.AGENT:
                vehicles.route[row, slot] = self._world.missions.route[row, agent_id]

    def _is_as_seen(self, transfer: Transfer) -> bool:
        """Return whether the vehicle's owner and agent are unchanged since the transfer was proposed."""
        row, slot, generation, owner, agent_id, *_ = transfer
        vehicles, agents = self._world.vehicles, self._world.agents
        if not vehicles.alive[row, slot] or vehicles.generation[row, slot] != generation:
            return False
        holders = np.flatnonzero(agents.slot[row] == slot)
        return agent_id == (holders[0] if len(holders) else UNSET) and vehicles.owner[row, slot] == owner

    def _can_go(self, transfer: Transfer) -> bool:
        """Return whether the new owner and the new agent fit, and that agent has no vehicle."""
        row, owner, to_agent = transfer.row, transfer.to_owner, transfer.to_agent
        has_agent = to_agent != UNSET or transfer.number != UNSET
        if owner == Owner.NOBODY:
            return not has_agent
        if owner == Owner.AGENT and not has_agent:
            return False
        if to_agent in (UNSET, transfer.from_agent):
            return True
        agents = self._world.agents
        is_pooled = self._pool is not None and self._pool.interface_id[to_agent] != UNSET
        is_handed_out = not is_pooled or agents.state[row, to_agent] != AgentStatus.VACANT
        return is_handed_out and agents.slot[row, to_agent] == UNSET

    def _give(self, row: int, agent_id: int, slot: int, state: AgentStatus) -> None:
        """Give a vehicle to an agent, which enters or becomes its driver."""
        agents, vehicles = self._world.agents, self._world.vehicles
        if agents.state[row, agent_id] == AgentStatus.SHADOWING:
            # What it has observed counts for nothing: its episode begins now.
            for column in (agents.distance_travelled, agents.lap, agents.lap_before, agents.via_hit):
                column[row, agent_id] = 0
            agents.off_route_since[row, agent_id] = UNSET
        agents.slot[row, agent_id] = slot
        agents.generation[row, agent_id] = vehicles.generation[row, slot]
        agents.state[row, agent_id] = state
        agents.entry_step[row, agent_id] = self._world.step[row]
        agents.next_due[row, agent_id] = self._world.step[row]
        agents.last_moved_position[row, agent_id] = vehicles.position[row, slot]
        agents.last_moved_step[row, agent_id] = self._world.step[row]

    def _release(self, row: int, agent_id: int) -> None:
        """Take the vehicle from an agent, whose column is vacant then."""
        agents = self._world.agents
        agents.slot[row, agent_id] = agents.release_step[row, agent_id] = UNSET
        agents.state[row, agent_id] = AgentStatus.VACANT
