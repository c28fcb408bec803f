"""Events: what happened to the agents in a step, and whose episode ended how."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.agents.rules import AliveRule
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import RouteTable
from smarts.roads.scene import Scene
from smarts.sim.columns import columns_of
from smarts.sim.event_rules import OFF_ROUTE_TIME, Rules, judge
from smarts.sim.judging import State, state_of
from smarts.sim.outcomes import is_truncating, outcome_of
from smarts.sim.tickets import issue_tickets
from smarts.types.events import Contacts, Event, Events, Outcome
from smarts.types.interface import SeatRules
from smarts.types.seats import SeatState
from smarts.types.world import World

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]

_COLLISION = int(Event.COLLISION)
_AGENTS_ALIVE, _INTEREST = int(Event.AGENTS_ALIVE_DONE), int(Event.INTEREST_DONE)
_VOID = int(Outcome.VOID)
_VACANT, _WAITING = int(SeatState.VACANT), int(SeatState.WAITING)
_SHADOWING, _ACTIVE, _DONE = int(SeatState.SHADOWING), int(SeatState.ACTIVE), int(SeatState.DONE)


class Interest(Protocol):
    """Knows which vehicles matter to whom."""

    def is_gone(self, world: World, rows: Bools) -> Bools:
        """Return for which seats no vehicle of interest is left, shape (B, A)."""
        ...


class EventColumns(NamedTuple):
    """`Events`."""

    bits: Ints
    just_done: Bools
    terminated: Bools
    truncated: Bools
    finished: Bools


class AliveColumns(NamedTuple):
    """R `AliveRule`s: the seat (R,), who is counted (R, A), how many there must be (R,)."""

    seat: Ints
    counted: Bools
    minimum: Ints


class AgentEvents:
    """Judges each agent by the rules of its seat.

    All events are told in every step, whether or not they end the agent's episode. What ends it decides the
    outcome; several endings in one step are put in order by `smarts.sim.outcomes`.

    Args:
        scene: The world, its maps and the agents' routes.
        rules: Of all seats.
        alive: Endings for want of others.
        interest: Tells when vehicles of interest are gone; needed if an agent ends by that.
    """

    def __init__(
        self,
        scene: Scene,
        rules: SeatRules,
        alive: Sequence[AliveRule] = (),
        interest: Interest | None = None,
    ) -> None:
        world = scene.world
        worlds, seats = world.seats.slot.shape
        self._interest = interest
        self._nobody = np.zeros((worlds, seats), np.bool_)
        self._events = Events.allocate(worlds, seats)
        counted = np.zeros((len(alive), seats), np.bool_)
        for number, rule in enumerate(alive):
            counted[number] = rule.counted
        counts = AliveColumns(
            np.array([rule.seat for rule in alive], np.int32),
            counted,
            np.array([rule.minimum for rule in alive], np.int32),
        )
        state, out = state_of(scene), columns_of(self._events, EventColumns)
        judged_by = columns_of(rules, Rules), counts, round(OFF_ROUTE_TIME / world.dt)
        self._begin = bind(begin_episodes, state, scene.routes.current, world.egos, out)
        self._detect = bind(detect_events, state, scene.routes.current, *judged_by, world.egos, out)

    def reset(self, world: World, contacts: Contacts, rows: Bools) -> Events:
        """Return the events at the beginning of an episode: none, unless an agent's vehicle overlaps another.

        Such an episode is void: all its agents are done before they have begun.
        """
        self._begin(contacts.partner, rows)
        return self._events

    def detect(self, world: World, contacts: Contacts, rows: Bools) -> Events:
        """Return what happened to the agents in this step."""
        gone = self._nobody if self._interest is None else self._interest.is_gone(world, rows)
        self._detect(contacts.partner, gone, rows)
        return self._events


@kernel
def _clear(out: EventColumns) -> None:
    """Forget the last step."""
    out.bits[:] = 0
    out.just_done[:] = False
    out.terminated[:] = False
    out.truncated[:] = False
    out.finished[:] = False


@kernel
def begin_episodes(
    state: State, table: RouteTable, egos: int, out: EventColumns, partner: Ints, rows: Bools
) -> None:
    """Void the episodes that begin with an overlap, and issue tickets in the others; see `AgentEvents`."""
    _clear(out)
    count = state.seats.slot.shape[1]
    for row in range(len(rows)):
        if not rows[row]:
            continue
        is_void = False
        for seat in range(count):
            state.laps_before[row, seat] = state.seats.lap[row, seat]
            if partner[row, seat] >= 0:
                out.bits[row, seat] = _COLLISION
                is_void = True
        if is_void:
            for seat in range(count):
                _close(state, row, seat, _VOID, out)
        else:
            issue_tickets(state, table, row)
        out.finished[row] = _is_finished(state, row, egos)


@kernel
def detect_events(
    state: State,
    table: RouteTable,
    rules: Rules,
    alive: AliveColumns,
    patience: int,
    egos: int,
    out: EventColumns,
    partner: Ints,
    gone: Bools,
    rows: Bools,
) -> None:
    """Write the events of all agents, and end episodes; see `AgentEvents`."""
    _clear(out)
    seats = state.seats
    for row in range(len(rows)):
        if not rows[row]:
            continue
        for seat in range(seats.slot.shape[1]):
            if seats.state[row, seat] in (_ACTIVE, _SHADOWING) and seats.slot[row, seat] >= 0:
                bits = judge(state, table, rules, patience, row, seat)
                bits |= _COLLISION if partner[row, seat] >= 0 else 0
                out.bits[row, seat] = bits | (_INTEREST if gone[row, seat] else 0)
            state.laps_before[row, seat] = seats.lap[row, seat]
        _miss_others(state, rules, alive, row, out.bits)
        for seat in range(seats.slot.shape[1]):
            ended = out.bits[row, seat] & rules.ending[seat]
            if ended and seats.state[row, seat] == _ACTIVE:
                _close(state, row, seat, outcome_of(ended), out)
        out.finished[row] = _is_finished(state, row, egos)
        issue_tickets(state, table, row)


@kernel
def _miss_others(state: State, rules: Rules, alive: AliveColumns, row: int, bits: Ints) -> None:
    """Add the events of those who have too few others left, when all that has happened so far is counted."""
    seats = state.seats
    for rule in range(len(alive.seat)):
        left = 0
        for seat in range(seats.slot.shape[1]):
            is_in = seats.state[row, seat] in (_WAITING, _SHADOWING, _ACTIVE)
            is_ending = bits[row, seat] & rules.ending[seat] & ~_AGENTS_ALIVE
            if is_ending and seats.state[row, seat] == _ACTIVE:
                is_in = False
            left += alive.counted[rule, seat] and is_in
        if left < alive.minimum[rule] and seats.state[row, alive.seat[rule]] == _ACTIVE:
            bits[row, alive.seat[rule]] |= _AGENTS_ALIVE


@kernel
def _close(state: State, row: int, seat: int, outcome: int, out: EventColumns) -> None:
    """End the episode of an agent that drives, or is still to come."""
    seats = state.seats
    was = seats.state[row, seat]
    if was in (_VACANT, _DONE):
        return
    seats.outcome[row, seat] = outcome
    seats.state[row, seat] = _VACANT if was == _WAITING else _DONE
    if was == _ACTIVE:
        out.just_done[row, seat] = True
        out.truncated[row, seat] = is_truncating(outcome)
        out.terminated[row, seat] = not is_truncating(outcome)


@kernel
def _is_finished(state: State, row: int, egos: int) -> bool:
    """Tell whether no learning agent drives or is to come."""
    left = 0
    for seat in range(egos):
        left += state.seats.state[row, seat] in (_WAITING, _ACTIVE, _SHADOWING)
    return left == 0
