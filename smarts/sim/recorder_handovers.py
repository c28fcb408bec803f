"""What the recorder notes of vehicles that change hands and of bubbles, and the tables of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.sim.agent_pool import Hold
from smarts.sim.episode_tables import Rows, columns_of, rows_of_holds
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import COUNTS, BubbleStates, PlacedBubble
from smarts.types.episode import AgentStart
from smarts.types.episode_schema import (
    AGENT_FAILURES,
    BUBBLE_POSES,
    BUBBLE_RINGS,
    BUBBLES,
    HOLDS,
    TRANSFERS,
    Table,
)
from smarts.types.transfers import CarriedOut

Vehicle = tuple[int, int]
"""Slot and generation."""


@dataclass
class HandoverNotes:
    """The notes on one episode."""

    holds: list[Hold] = field(default_factory=list)
    transfers: list[tuple[int, ...]] = field(default_factory=list)
    """Rows of the table, without the names of vehicles."""
    poses: list[tuple[float, ...]] = field(default_factory=list)
    """Rows of the table of bubbles' poses."""
    counts: list[list[int]] = field(default_factory=list)
    """Counts of `COUNTS`, by bubble."""
    failures: list[tuple[int, int, str]] = field(default_factory=list)
    """Step, number of the agent, and what failed."""
    _holder: dict[int, int] = field(default_factory=dict)
    """Number of the last agent of each column."""
    _poses_before: Floats = field(default_factory=lambda: np.zeros((0, 4)))

    def take_holds(self, holds: Sequence[Hold]) -> None:
        """Note further holds; after the step's transfers."""
        self.holds += holds
        self._holder.update((hold.agent_id, hold.number) for hold in holds)

    def take_transfer(self, step: int, carried_out: CarriedOut, numbers: Ints) -> None:
        """Note a transfer.

        Args:
            step: The first state after it.
            carried_out: The transfer.
            numbers: Numbers of the agents that have, or have had, the columns after the step, shape (A,).
        """
        transfer = carried_out.transfer
        from_number = self._holder.get(transfer.from_agent, UNSET)
        to_number = transfer.number if transfer.to_agent == UNSET else int(numbers[transfer.to_agent])
        vehicle = transfer.slot, transfer.generation, transfer.from_owner, transfer.to_owner
        why = transfer.reason, carried_out.refusals, carried_out.last_refusal, transfer.departure
        self.transfers.append((step, *vehicle, from_number, to_number, *why))

    def take_bubbles(self, step: int, row: int, count: int, states: BubbleStates) -> None:
        """Note the counts of a simulation's bubbles, and the poses that have changed, at the reset all."""
        self.counts = np.stack([getattr(states, name)[row, :count] for name in COUNTS], axis=1).tolist()
        now = np.empty((count, 4))
        now[:, :3], now[:, 3] = states.pose[row, :count], states.is_active[row, :count]
        before, self._poses_before = self._poses_before, now
        changed = (now != before).any(axis=1) if len(before) else np.ones(count, np.bool_)
        self.poses += [(step, number, *now[number].tolist()) for number in np.flatnonzero(changed).tolist()]


def handover_tables(
    notes: HandoverNotes,
    starts: Sequence[AgentStart],
    states: Mapping[str, Floats],
    names: Mapping[Vehicle, str],
    policies: Sequence[str],
    bubbles: Sequence[PlacedBubble],
) -> dict[str, Rows]:
    """Return the tables of holds, transfers, bubbles and failures.

    Args:
        notes: Notes of the episode.
        starts: How the agents enter, by number.
        states: Columns of `agent_states`.
        names: Public names of the recorded vehicles.
        policies: Names of the social policies, by number.
        bubbles: Bubbles of the episode.
    """
    transfers = [
        (step, slot, generation, names.get((slot, generation), ""), *others)
        for step, slot, generation, *others in notes.transfers
    ]
    facts = [
        (number, each.id, each.actor, each.followed, *notes.counts[number])
        for number, each in enumerate(bubbles)
    ]
    rows: dict[Table, Sequence[tuple]] = {
        HOLDS: [*_holds(notes, starts, states, policies)],
        TRANSFERS: transfers,
        BUBBLES: facts,
        BUBBLE_RINGS: [*ring_rows(bubbles)],
        BUBBLE_POSES: notes.poses,
        AGENT_FAILURES: notes.failures,
    }
    return {table.name: columns_of(table.names, each) for table, each in rows.items()}


def _holds(
    notes: HandoverNotes, starts: Sequence[AgentStart], states: Mapping[str, Floats], policies: Sequence[str]
) -> Iterator[tuple]:
    """Yield a row for each hold in which the agent has had a vehicle."""
    first, last = rows_of_holds(states, notes.holds)
    began, ended = _reasons(notes.transfers)
    for hold, begin, end in zip(notes.holds, first.tolist(), last.tolist(), strict=True):
        if end == UNSET:
            continue
        start = starts[hold.number]
        policy = policies[start.policy] if 0 <= start.policy < len(policies) else ""
        steps = states["step"][begin], states["step"][end]
        vehicle = states["slot"][end], states["generation"][end]
        reasons = began.get(hold.number, UNSET), ended.get(hold.number, UNSET)
        yield hold.number, hold.agent_id, start.name, policy, start.interface, *steps, *vehicle, *reasons


def ring_rows(bubbles: Sequence[PlacedBubble]) -> Iterator[tuple[int, bool, list[float], list[float]]]:
    """Yield the rows of the table `bubble_rings`."""
    for number, bubble in enumerate(bubbles):
        for is_margin, rings in enumerate((bubble.zone, bubble.margin)):
            for ring in rings:
                yield number, bool(is_margin), *ring.T.tolist()


def _reasons(transfers: Sequence[tuple[int, ...]]) -> tuple[dict[int, int], dict[int, int]]:
    """Return the reasons of the transfers that brought and that took agents' vehicles, by agent."""
    began: dict[int, int] = {}
    ended: dict[int, int] = {}
    for transfer in transfers:
        from_agent, to_agent, reason = transfer[5:8]
        if from_agent != to_agent:
            ended[from_agent] = began[to_agent] = reason
    return began, ended
