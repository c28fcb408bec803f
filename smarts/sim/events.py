"""Events: what happened to the agents in a step, and how their episodes ended."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.rules import AliveRule
from smarts.arrays import Bools, Ints
from smarts.geometry.binding import LateBound
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.scene import Scene
from smarts.sim.arrival_order import assign_arrival_order
from smarts.sim.bubble_rules import BubbleRules
from smarts.sim.event_rules import OFF_ROUTE_TIME, judge
from smarts.sim.interest import NamedInterest
from smarts.sim.outcomes import is_truncating, outcome_of
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Contacts, Event, Events, Outcome
from smarts.types.interface import AgentRules
from smarts.types.world import State

_COLLISION = int(Event.COLLISION)
_LEFT_BUBBLE, _TIME_OUT = int(Event.LEFT_BUBBLE), int(Event.REACHED_MAX_EPISODE_STEPS)
_AGENTS_ALIVE, _INTEREST = int(Event.AGENTS_ALIVE_DONE), int(Event.INTEREST_DONE)
_INVALID = int(Outcome.INVALID)
_VACANT, _WAITING = int(AgentStatus.VACANT), int(AgentStatus.WAITING)
_SHADOWING, _ACTIVE, _DONE = int(AgentStatus.SHADOWING), int(AgentStatus.ACTIVE), int(AgentStatus.DONE)


class AliveColumns(NamedTuple):
    """R `AliveRule`s: the agent (R,), the agents that are counted (R, A), how many must be left (R,).

    `coming` is how many agents have no column yet, shape (B,).
    """

    agent_id: Ints
    counted: Bools
    minimum: Ints
    coming: Ints


class LearningInBubbles(NamedTuple):
    """Egos that drive the vehicles in bubbles: they end where those leave, the episode ends by its time."""

    bubbles: BubbleRules
    end: int
    """Step with which episodes end."""


class AgentEvents:
    """Finds each agent's events, and ends episodes by the rules of the agents' interfaces.

    Every step reports all events, whether or not they end the agent's episode. The event that ends it decides
    the outcome; `smarts.sim.outcomes` orders several endings in one step.

    Args:
        scene: The world, its maps and the agents' routes.
        rules: Rules of all agents.
        alive: Endings by the number of agents that are left.
        interest: Finds vehicles of interest; needed if an agent ends by them.
        coming: How many agents get their column when they enter, shape (B,); they are left, too. None: all
            agents have one.
        learning: Where agents learn in bubbles: agents that have left them, and when episodes end.
    """

    def __init__(
        self,
        scene: Scene,
        rules: AgentRules,
        alive: Sequence[AliveRule] = (),
        interest: NamedInterest | None = None,
        coming: Ints | None = None,
        learning: LearningInBubbles | None = None,
    ) -> None:
        world = scene.world
        worlds, agents = world.agents.slot.shape
        self._interest, self._learning = interest, learning
        self._nobody = np.zeros((worlds, agents), np.bool_)
        self.events = Events.allocate(worlds, agents)
        """Events of the last step."""
        counted = np.zeros((len(alive), agents), np.bool_)
        for number, rule in enumerate(alive):
            counted[number] = rule.counted
        counts = AliveColumns(
            np.array([rule.agent_id for rule in alive], np.int32),
            counted,
            np.array([rule.minimum for rule in alive], np.int32),
            np.zeros(worlds, np.int32) if coming is None else coming,
        )
        end = 0 if learning is None else learning.end
        given = world.state, scene.atlas.roads, scene.routes.current, world.egos, end, self.events
        patience = round(OFF_ROUTE_TIME / world.dt)
        self._begin = LateBound(begin_episodes, *given)
        self._detect = LateBound(detect_events, *given, rules, counts, patience)

    @property
    def columns(self) -> Sequence[NDArray]:
        """The events of each agent, to be cleared for another agent, shape (B, A)."""
        return [column for column in self.events if column.ndim == 2]

    def reset(self, contacts: Contacts, env_mask: Bools) -> Events:
        """Return the events at the beginning of an episode: none, unless an agent's vehicle overlaps another.

        Such an episode is invalid: all its agents are done before they begin.
        """
        self._begin.to(contacts)(env_mask)
        return self.events

    def detect(self, contacts: Contacts, env_mask: Bools) -> Events:
        """Return what happened to the agents in this step."""
        gone = self._nobody if self._interest is None else self._interest.is_gone(env_mask)
        left = self._nobody if self._learning is None else self._learning.bubbles.left
        self._detect.to(contacts)(gone, left, env_mask)
        return self.events


@kernel
def _clear(out: Events) -> None:
    """Clear the events of the last step."""
    out.bits[:] = 0
    out.just_done[:] = False
    out.terminated[:] = False
    out.truncated[:] = False
    out.finished[:] = False


@kernel
def begin_episodes(
    state: State,
    roads: Roads,
    routes: RouteTable,
    egos: int,
    end: int,
    out: Events,
    contacts: Contacts,
    env_mask: Bools,
) -> None:
    """Mark episodes that begin with an overlap as invalid, rank arrivals in the others; see `AgentEvents`."""
    _clear(out)
    count = state.agents.slot.shape[1]
    for row in np.flatnonzero(env_mask):
        is_invalid = False
        for agent_id in range(count):
            state.agents.lap_before[row, agent_id] = state.agents.lap[row, agent_id]
            if contacts.partner[row, agent_id] >= 0:
                out.bits[row, agent_id] = _COLLISION
                is_invalid = True
        if is_invalid:
            for agent_id in range(count):
                _close(state, row, agent_id, _INVALID, out)
        else:
            assign_arrival_order(state, roads, routes, row)
        out.finished[row] = _is_finished(state, row, egos, end)


@kernel
def detect_events(
    state: State,
    roads: Roads,
    routes: RouteTable,
    egos: int,
    end: int,
    out: Events,
    rules: AgentRules,
    alive: AliveColumns,
    patience: int,
    contacts: Contacts,
    gone: Bools,
    left: Bools,
    env_mask: Bools,
) -> None:
    """Write the events of all agents, and end episodes; see `AgentEvents`."""
    _clear(out)
    agents = state.agents
    for row in np.flatnonzero(env_mask):
        for agent_id in range(agents.slot.shape[1]):
            if agents.state[row, agent_id] in (_ACTIVE, _SHADOWING) and agents.slot[row, agent_id] >= 0:
                bits = judge(state, roads, routes, rules, patience, row, agent_id)
                bits |= _COLLISION if contacts.partner[row, agent_id] >= 0 else 0
                out.bits[row, agent_id] = bits | (_INTEREST if gone[row, agent_id] else 0)
            agents.lap_before[row, agent_id] = agents.lap[row, agent_id]
        _miss_others(state, rules, alive, row, out.bits)
        is_over = 0 < end <= state.step[row]
        for agent_id in range(agents.slot.shape[1]):
            ended = out.bits[row, agent_id] & rules.ending[agent_id]
            if end and agent_id < egos:
                ended |= _end_in_bubble(out, left, is_over, row, agent_id)
            if ended and agents.state[row, agent_id] == _ACTIVE:
                _close(state, row, agent_id, outcome_of(ended), out)
        out.finished[row] = _is_finished(state, row, egos, end)
        assign_arrival_order(state, roads, routes, row)


@kernel
def _miss_others(state: State, rules: AgentRules, alive: AliveColumns, row: int, bits: Ints) -> None:
    """Add the events of agents for which too few others are left, given all other events of the step."""
    agents = state.agents
    for rule in range(len(alive.agent_id)):
        if agents.state[row, alive.agent_id[rule]] != _ACTIVE:
            continue
        # Only a rule that counts all agents counts the pool's, whose columns are the last.
        left = alive.coming[row] if alive.counted[rule, -1] else 0
        for agent_id in range(agents.slot.shape[1]):
            is_in = agents.state[row, agent_id] in (_WAITING, _SHADOWING, _ACTIVE)
            is_ending = bits[row, agent_id] & rules.ending[agent_id] & ~_AGENTS_ALIVE
            if is_ending and agents.state[row, agent_id] == _ACTIVE:
                is_in = False
            left += alive.counted[rule, agent_id] and is_in
        if left < alive.minimum[rule]:
            bits[row, alive.agent_id[rule]] |= _AGENTS_ALIVE


@kernel
def _close(state: State, row: int, agent_id: int, outcome: int, out: Events) -> None:
    """End the episode of an agent that is active, shadowing or waiting."""
    agents = state.agents
    was = agents.state[row, agent_id]
    if was in (_VACANT, _DONE):
        return
    agents.outcome[row, agent_id] = outcome
    agents.state[row, agent_id] = _VACANT if was == _WAITING else _DONE
    if was == _ACTIVE:
        out.just_done[row, agent_id] = True
        out.truncated[row, agent_id] = is_truncating(outcome)
        out.terminated[row, agent_id] = not is_truncating(outcome)


@kernel
def _end_in_bubble(out: Events, left: Bools, is_over: bool, row: int, agent_id: int) -> int:
    """Add and return the events that end an agent that learns in a bubble."""
    bits = _LEFT_BUBBLE if left[row, agent_id] else 0
    bits |= _TIME_OUT if is_over else 0
    out.bits[row, agent_id] |= bits
    return bits


@kernel
def _is_finished(state: State, row: int, egos: int, end: int) -> bool:
    """Return whether no ego is active or waiting; where egos learn in bubbles, whether time is over."""
    if end:
        return bool(state.step[row] >= end)
    left = 0
    for agent_id in range(egos):
        left += state.agents.state[row, agent_id] in (_WAITING, _ACTIVE, _SHADOWING)
    return left == 0
