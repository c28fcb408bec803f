"""Ownership: the only place that says who drives which vehicle, and which seat it belongs to.

Providers follow: at the beginning of their stage they compare the owner column with what they saw last. So a
hand-over is a write to one row, pose and speed stay as they are, and nothing is carried from one provider to
the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.types.episode import SeatStart
from smarts.types.seats import NEITHER, SeatState
from smarts.types.transfers import NO_TRANSFERS, Refusal, Transfers
from smarts.types.vehicles import Owner
from smarts.types.world import World

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]


class Driver(Protocol):
    """What ownership asks of a provider before it hands over a vehicle."""

    def can_accept(self, rows: Ints, slots: Ints) -> NDArray[np.int8]:
        """Return for each vehicle the `Refusal` to drive on with it from where it is; changes nothing."""
        ...


class Ownership:
    """Lets vehicles in for agents, and carries out transfers, each wholly or not at all.

    Always true of every simulation: a vehicle is in at most one seat; a seat with a slot holds a vehicle that
    is alive and of the seat's generation; an active seat's vehicle is owned by AGENT.

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

    def admit(self, row: int, seat: int, start: SeatStart) -> int:
        """Let an agent's vehicle in at its start, put the agent in the seat, and return the slot.

        Raises:
            TrafficError: No slot is free.
        """
        slot = self._world.registry.admit(row, start.name, Owner.AGENT, start.kind, start.length, start.width)
        vehicles = self._world.vehicles
        x, y, vehicles.heading[row, slot] = start.pose
        vehicles.position[row, slot] = x, y
        vehicles.speed[row, slot] = start.speed
        vehicles.route[row, slot] = self._world.missions.route[row, seat]
        self._sit(row, seat, slot, SeatState.ACTIVE)
        return slot

    def submit(self, transfers: Transfers) -> None:
        """Put transfers in the queue; they happen when their simulation makes its next step."""
        if len(transfers):
            self._queue = np.concatenate([self._queue, transfers])

    def apply(self, rows: Bools) -> Sequence[Any]:
        """Carry out what is pending in some simulations; return the transfers that were refused.

        They are tried in the order of `Reason`, then by seat, then by slot, whatever the order in which they
        were proposed. One is refused, and changes nothing, if its vehicle is gone or no longer with the owner
        and the seat that the proposer saw, if the seat it is to go to is taken, or if the new owner cannot
        drive on with it.
        """
        if not len(self._queue):
            return ()
        due = rows[self._queue["row"]]
        pending, self._queue = self._queue[due], self._queue[~due]
        order = np.lexsort((pending["slot"], pending["to_seat"], pending["reason"], pending["row"]))
        pending = pending[order]
        is_accepted = self._answers(pending) == Refusal.NONE
        return [
            transfer
            for transfer, accepted in zip(pending, is_accepted.tolist(), strict=True)
            if not (accepted and self._carry_out(transfer))
        ]

    def _answers(self, pending: Transfers) -> NDArray[np.int8]:
        """Return what the new owners answer to transfers, shape (T,); each is asked once for all of its."""
        answers = np.full(len(pending), Refusal.NONE, np.int8)
        changes = pending["to_owner"] != pending["from_owner"]
        for owner, driver in self._drivers.items():
            asked = changes & (pending["to_owner"] == owner)
            if asked.any():
                answers[asked] = driver.can_accept(pending["row"][asked], pending["slot"][asked])
        return answers

    def _carry_out(self, transfer: Any) -> bool:
        row, slot, to_seat = int(transfer["row"]), int(transfer["slot"]), int(transfer["to_seat"])
        if not (self._is_as_seen(transfer) and self._can_go(transfer)):
            return False
        from_seat, owner = int(transfer["from_seat"]), int(transfer["to_owner"])
        vehicles = self._world.vehicles
        if from_seat not in (NEITHER, to_seat):
            self._rise(row, from_seat)
        if owner == Owner.NOBODY:
            self._world.registry.dismiss(row, slot)
            return True
        if owner != vehicles.owner[row, slot]:
            vehicles.owner[row, slot] = owner
            # Whoever drives now has plans of its own.
            vehicles.route[row, slot] = NEITHER
        if to_seat != NEITHER:
            state = SeatState.ACTIVE if owner == Owner.AGENT else SeatState.SHADOWING
            self._sit(row, to_seat, slot, state)
            if owner == Owner.AGENT:
                vehicles.route[row, slot] = self._world.missions.route[row, to_seat]
        return True

    def _is_as_seen(self, transfer: Any) -> bool:
        """Return whether the vehicle is still with whom the proposer saw it."""
        row, slot = int(transfer["row"]), int(transfer["slot"])
        vehicles, seats = self._world.vehicles, self._world.seats
        if not vehicles.alive[row, slot] or vehicles.generation[row, slot] != transfer["generation"]:
            return False
        holders = np.flatnonzero(seats.slot[row] == slot)
        seat = int(holders[0]) if len(holders) else NEITHER
        return seat == transfer["from_seat"] and vehicles.owner[row, slot] == transfer["from_owner"]

    def _can_go(self, transfer: Any) -> bool:
        """Return whether the vehicle can go where it is to go."""
        row = int(transfer["row"])
        owner, to_seat = int(transfer["to_owner"]), int(transfer["to_seat"])
        if owner == Owner.NOBODY:
            return to_seat == NEITHER
        if owner == Owner.AGENT and to_seat == NEITHER:
            return False
        is_taken = to_seat != NEITHER and to_seat != transfer["from_seat"]
        return not (is_taken and self._world.seats.slot[row, to_seat] != NEITHER)

    def _sit(self, row: int, seat: int, slot: int, state: SeatState) -> None:
        seats, vehicles = self._world.seats, self._world.vehicles
        seats.slot[row, seat] = slot
        seats.generation[row, seat] = vehicles.generation[row, slot]
        seats.state[row, seat] = state
        seats.entry_step[row, seat] = self._world.step[row]
        seats.next_due[row, seat] = self._world.step[row]
        seats.rest_position[row, seat] = vehicles.position[row, slot]
        seats.rest_step[row, seat] = self._world.step[row]

    def _rise(self, row: int, seat: int) -> None:
        seats = self._world.seats
        seats.slot[row, seat] = NEITHER
        seats.state[row, seat] = SeatState.VACANT
