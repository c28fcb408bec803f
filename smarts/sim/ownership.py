"""Ownership: the only place that says who drives which vehicle, and which agent it belongs to.

Providers follow: at the beginning of their stage they compare the owner column with what they saw last. So a
hand-over is a write to one row, pose and speed stay as they are, and nothing is carried from one provider to
the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart
from smarts.types.transfers import NO_TRANSFERS, Refusal, Transfers
from smarts.types.vehicles import Owner
from smarts.types.world import World


class Driver(Protocol):
    """What ownership asks of a provider before it hands over a vehicle."""

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """Return for each vehicle the `Refusal` to drive on with it from where it is; changes nothing."""
        ...


class Ownership:
    """Lets vehicles in for agents, and carries out transfers, each wholly or not at all.

    Invariants of every simulation: at most one agent holds a vehicle; an agent with a slot holds a vehicle
    that is alive and of the agent's generation; an active agent's vehicle is owned by AGENT.

    Args:
        world: What is written to.
        drivers: The providers by their number.
    """

    def __init__(self, world: World, drivers: Mapping[int, Driver]) -> None:
        self._world = world
        self._drivers = drivers
        self._queue = NO_TRANSFERS

    def clear(self, row: int) -> None:
        """Forget the transfers that are pending in one simulation."""
        self._queue = self._queue[self._queue["row"] != row]

    def admit(self, row: int, agent_id: int, start: AgentStart) -> int:
        """Let an agent's vehicle in at its start, put the agent in the agent, and return the slot.

        Raises:
            TrafficError: No slot is free.
        """
        slot = self._world.registry.admit(row, start.name, Owner.AGENT, start.kind, start.length, start.width)
        vehicles = self._world.vehicles
        x, y, vehicles.heading[row, slot] = start.pose
        vehicles.position[row, slot] = x, y
        vehicles.speed[row, slot] = start.speed
        vehicles.route[row, slot] = self._world.missions.route[row, agent_id]
        self._sit(row, agent_id, slot, AgentStatus.ACTIVE)
        return slot

    def submit(self, transfers: Transfers) -> None:
        """Put transfers in the queue; they happen when their simulation makes its next step."""
        if len(transfers):
            self._queue = np.concatenate([self._queue, transfers])

    def apply(self, env_mask: Bools) -> Sequence[Any]:
        """Carry out what is pending in some simulations; return the transfers that were refused.

        They are tried in the order of `Reason`, then by agent, then by slot, whatever the order in which they
        were proposed. One is refused, and changes nothing, if its vehicle is gone or no longer with the owner
        and the agent that the proposer saw, if the agent it is to go to is taken, or if the new owner cannot
        drive on with it.
        """
        if not len(self._queue):
            return ()
        due = env_mask[self._queue["row"]]
        pending, self._queue = self._queue[due], self._queue[~due]
        order = np.lexsort((pending["slot"], pending["to_agent"], pending["reason"], pending["row"]))
        pending = pending[order]
        is_accepted = self._answers(pending) == Refusal.NONE
        return [
            transfer
            for transfer, accepted in zip(pending, is_accepted.tolist(), strict=True)
            if not (accepted and self._carry_out(transfer))
        ]

    def _answers(self, pending: Transfers) -> Bytes:
        """Return what the new owners answer to transfers, shape (T,); each is asked once for all of its."""
        answers = np.full(len(pending), Refusal.NONE, np.int8)
        changes = pending["to_owner"] != pending["from_owner"]
        for owner, driver in self._drivers.items():
            asked = changes & (pending["to_owner"] == owner)
            if asked.any():
                answers[asked] = driver.can_accept(pending["row"][asked], pending["slot"][asked])
        return answers

    def _carry_out(self, transfer: Any) -> bool:
        row, slot, to_agent = int(transfer["row"]), int(transfer["slot"]), int(transfer["to_agent"])
        if not (self._is_as_seen(transfer) and self._can_go(transfer)):
            return False
        from_agent, owner = int(transfer["from_agent"]), int(transfer["to_owner"])
        vehicles = self._world.vehicles
        if from_agent not in (UNSET, to_agent):
            self._rise(row, from_agent)
        if owner == Owner.NOBODY:
            self._world.registry.dismiss(row, slot)
            return True
        if owner != vehicles.owner[row, slot]:
            vehicles.owner[row, slot] = owner
            # Whoever drives now has plans of its own.
            vehicles.route[row, slot] = UNSET
        if to_agent != UNSET:
            state = AgentStatus.ACTIVE if owner == Owner.AGENT else AgentStatus.SHADOWING
            self._sit(row, to_agent, slot, state)
            if owner == Owner.AGENT:
                vehicles.route[row, slot] = self._world.missions.route[row, to_agent]
        return True

    def _is_as_seen(self, transfer: Any) -> bool:
        """Return whether the vehicle is still with whom the proposer saw it."""
        row, slot = int(transfer["row"]), int(transfer["slot"])
        vehicles, agents = self._world.vehicles, self._world.agents
        if not vehicles.alive[row, slot] or vehicles.generation[row, slot] != transfer["generation"]:
            return False
        holders = np.flatnonzero(agents.slot[row] == slot)
        agent_id = int(holders[0]) if len(holders) else UNSET
        return agent_id == transfer["from_agent"] and vehicles.owner[row, slot] == transfer["from_owner"]

    def _can_go(self, transfer: Any) -> bool:
        """Return whether the vehicle can go where it is to go."""
        row = int(transfer["row"])
        owner, to_agent = int(transfer["to_owner"]), int(transfer["to_agent"])
        if owner == Owner.NOBODY:
            return to_agent == UNSET
        if owner == Owner.AGENT and to_agent == UNSET:
            return False
        is_taken = to_agent != UNSET and to_agent != transfer["from_agent"]
        return not (is_taken and self._world.agents.slot[row, to_agent] != UNSET)

    def _sit(self, row: int, agent_id: int, slot: int, state: AgentStatus) -> None:
        agents, vehicles = self._world.agents, self._world.vehicles
        agents.slot[row, agent_id] = slot
        agents.generation[row, agent_id] = vehicles.generation[row, slot]
        agents.state[row, agent_id] = state
        agents.entry_step[row, agent_id] = self._world.step[row]
        agents.next_due[row, agent_id] = self._world.step[row]
        agents.last_moved_position[row, agent_id] = vehicles.position[row, slot]
        agents.last_moved_step[row, agent_id] = self._world.step[row]

    def _rise(self, row: int, agent_id: int) -> None:
        agents = self._world.agents
        agents.slot[row, agent_id] = UNSET
        agents.state[row, agent_id] = AgentStatus.VACANT
