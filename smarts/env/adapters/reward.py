"""Rewards: weighted sums, with the weights in YAML."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from smarts.env.adapters.protocol import Served
from smarts.errors import ScenarioError, nearest_names
from smarts.geometry.compiling import kernel
from smarts.types.events import Event, Outcome
from smarts.types.frame import Frame

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bytes = NDArray[np.int8]
Bools = NDArray[np.bool_]

DECISIONS = 120
"""What the cost of time is spread over where there is no time limit."""

_FILE = Path(__file__).with_name("rewards.yaml")


@dataclass(frozen=True)
class RewardWeights:
    """What a decision is worth. A weight is added (times what it weighs), so that costs are negative."""

    discount: float = 0.99
    """By which the learner discounts one decision: shaping by a potential needs the same."""
    progress: float = 0.0
    """Of the potential's gain, discount * potential after - potential before. The potential is the share of
    the route that is left, negative, and 0 when the agent's episode has ended for good."""
    time: float = 0.0
    """For all decisions up to the time limit together."""
    each_step: float = 0.0
    """For each step."""
    metres: float = 0.0
    """For each metre gone along the route."""
    goal_distance: float = 0.0
    """For each step and metre between the agent and its goal then, as the crow flies (of all steps of a
    decision, the distance at its end counts)."""
    approach: float = 0.0
    """For each metre by which that distance has become less."""
    centring: float = 0.0
    """For each metre by which the distance to the lane's centre has become less."""
    goal: float = 0.0
    collision: float = 0.0
    off_road: float = 0.0
    off_route: float = 0.0
    missed_goal: float = 0.0
    not_moving: float = 0.0
    time_out: float = 0.0
    wrong_way: float = 0.0
    """For each decision in which it happens; as the others, where they do not end the episode."""
    on_shoulder: float = 0.0


def reward_weights(name: str = "benchmark", **changes: float) -> RewardWeights:
    """Return weights of `rewards.yaml`, with some of them changed.

    Raises:
        ScenarioError: There are no such weights; the remedy names those that are nearest.
    """
    known: Mapping[str, Mapping[str, float]] = yaml.safe_load(_FILE.read_text())
    if name not in known:
        raise ScenarioError(
            f"there is no reward {name!r}", place=str(_FILE), remedy=nearest_names(name, known)
        )
    chosen = {**known[name], **changes}
    terms = [field.name for field in dataclasses.fields(RewardWeights)]
    for term, weight in chosen.items():
        if term not in terms:
            raise ScenarioError(
                f"there is no reward term {term!r}",
                place=f"{_FILE}: {name}",
                remedy=nearest_names(term, terms),
            )
        if not isinstance(weight, int | float) or not np.isfinite(weight):
            raise ScenarioError(f"{term} is {weight!r}, not a number", place=f"{_FILE}: {name}")
    return RewardWeights(**chosen)


class Terms(NamedTuple):
    """Weights as the kernel takes them."""

    by_outcome: Floats
    """What each `Outcome` is worth, shape (outcomes,)."""
    event: Ints
    """Bits of events that count where they do not end the episode, shape (E,)."""
    by_event: Floats
    """What they are worth, shape (E,)."""
    always: Ints
    """Bits of those events that count even in the decision that ends the episode."""
    shares: Floats
    """discount, progress, time of one decision, each_step, metres, goal_distance, approach, centring."""


_OUTCOMES = {
    Outcome.COLLISION: "collision",
    Outcome.OFF_ROAD: "off_road",
    Outcome.OFF_ROUTE: "off_route",
    Outcome.MISSED_GOAL: "missed_goal",
    Outcome.GOAL: "goal",
    Outcome.NOT_MOVING: "not_moving",
    Outcome.TIME_OUT: "time_out",
}
_EVENTS = {
    Event.COLLISION: "collision",
    Event.OFF_ROAD: "off_road",
    Event.OFF_ROUTE: "off_route",
    Event.MISSED_GOAL: "missed_goal",
    Event.REACHED_GOAL: "goal",
    Event.NOT_MOVING: "not_moving",
    Event.WRONG_WAY: "wrong_way",
    Event.ON_SHOULDER: "on_shoulder",
}


def reward_terms(weights: RewardWeights, horizon: float) -> Terms:
    """Return the weights for the kernel, with `horizon` decisions up to the time limit."""
    by_outcome = np.zeros(len(Outcome))
    for outcome, name in _OUTCOMES.items():
        by_outcome[outcome] = getattr(weights, name)
    shares = [weights.discount, weights.progress, weights.time / horizon, weights.each_step]
    shares += [weights.metres, weights.goal_distance, weights.approach, weights.centring]
    return Terms(
        by_outcome,
        np.array([*_EVENTS], np.int32),
        np.array([getattr(weights, name) for name in _EVENTS.values()]),
        np.array([Event.WRONG_WAY | Event.ON_SHOULDER], np.int32),
        np.array(shares),
    )


class Memory(NamedTuple):
    """What the reward remembers of each agent from one decision to the next, shape (B, G)."""

    initial: Floats
    """Length of the route when the agent entered [m], 0 before."""
    potential: Floats
    """At the last decision."""
    remaining: Floats
    """Of the route at the last decision [m]."""
    goal_distance: Floats
    """At the last decision [m]."""
    centring: Floats
    """Distance to the lane's centre at the last decision [m]."""
    events: Ints
    """Bits of what has happened since then."""
    steps: Ints
    """Since then."""

    @classmethod
    def allocate(cls, worlds: int, agents: int) -> Memory:
        """Return memories of nobody."""
        shape = (worlds, agents)
        return cls(
            initial=np.zeros(shape),
            potential=np.zeros(shape),
            remaining=np.zeros(shape),
            goal_distance=np.zeros(shape),
            centring=np.zeros(shape),
            events=np.zeros(shape, np.int32),
            steps=np.zeros(shape, np.int32),
        )


@kernel
def _worth_of_events(terms: Terms, happened: int, outcome: int) -> float:
    """Return what a decision's events are worth, and the outcome unless it is -1."""
    worth = 0.0
    if outcome >= 0:
        worth += terms.by_outcome[outcome]
        happened &= terms.always[0]
    for event in range(len(terms.event)):
        if happened & terms.event[event]:
            worth += terms.by_event[event]
    return worth


@kernel
def add_rewards(
    terms: Terms,
    memory: Memory,
    seats: Ints,
    here: Bools,
    settle: Bools,
    slot: Ints,
    outcome: Bytes,
    remaining: Floats,
    goal: Bytes,
    goal_position: Floats,
    position: Floats,
    lane_offset: Floats,
    bits: Ints,
    just_done: Bools,
    terminated: Bools,
    rewards: Singles,
) -> None:
    """Take one step in, and write the reward of the decision for those with whom it ends.

    Who is met for the first time is only remembered: nothing was decided so far.

    Args:
        terms: The weights.
        memory: Of the last decision.
        seats: The adapter's agents, shape (G,).
        here: Who was in this step, shape (B, G).
        settle: Whose decision ends with it, shape (B, G).
        slot: Of each seat's vehicle, shape (B, A), as the columns of `Seats` and `Missions` that follow.
        outcome: An `Outcome`.
        remaining: [m]
        goal: A `GoalKind`, 0 without a goal.
        goal_position: [m], shape (B, A, 2).
        position: Of the vehicles [m], shape (B, V, 2).
        lane_offset: Of the vehicles [m], shape (B, V).
        bits: Events of the step, shape (B, A), as those that follow.
        just_done: Whose episode ended in the step.
        terminated: For good.
        rewards: Written, shape (B, G).
    """
    discount, progress, time, each_step, metres, far, approach, centring = terms.shares
    for b in range(here.shape[0]):
        for g in range(len(seats)):
            if not here[b, g]:
                continue
            seat = seats[g]
            own = slot[b, seat]
            is_first = memory.initial[b, g] == 0.0
            memory.events[b, g] |= bits[b, seat]
            memory.steps[b, g] += 1
            if not (settle[b, g] or is_first):
                continue
            left, potential, distance = remaining[b, seat], 0.0, 0.0
            if is_first:
                memory.initial[b, g] = max(left, 1.0)
            if goal[b, seat] != 0:
                share = left / memory.initial[b, g]
                potential = -min(1.0, max(0.0, share))
                dx = goal_position[b, seat, 0] - position[b, own, 0]
                dy = goal_position[b, seat, 1] - position[b, own, 1]
                distance = np.sqrt(dx * dx + dy * dy)
            aside = abs(lane_offset[b, own])
            if not is_first:
                after = 0.0 if terminated[b, seat] else potential
                reward = progress * (discount * after - memory.potential[b, g]) + time
                reward += metres * (memory.remaining[b, g] - left)
                reward += far * distance * memory.steps[b, g]
                reward += approach * (memory.goal_distance[b, g] - distance)
                reward += centring * (memory.centring[b, g] - aside)
                reward += each_step * memory.steps[b, g]
                ending = outcome[b, seat] if just_done[b, seat] else -1
                reward += _worth_of_events(terms, memory.events[b, g], ending)
                rewards[b, g] = reward
            memory.potential[b, g], memory.remaining[b, g] = potential, left
            memory.goal_distance[b, g], memory.centring[b, g] = distance, aside
            memory.events[b, g], memory.steps[b, g] = 0, 0


class Rewards:
    """What the decisions of some agents are worth.

    Args:
        served: The agents.
        weights: Name of the weights in `rewards.yaml`, or the weights themselves.
    """

    def __init__(self, served: Served, weights: str | RewardWeights) -> None:
        self._served = served
        chosen = reward_weights(weights) if isinstance(weights, str) else weights
        horizon = served.max_steps / served.period if served.max_steps else DECISIONS
        self._terms = reward_terms(chosen, horizon)
        worlds, agents = served.scene.world.worlds, len(served.agents)
        self._memory = Memory.allocate(worlds, agents)
        self.values: Singles = np.zeros((worlds, agents), np.float32)
        """Of the last decision, shape (B, G)."""

    def add(self, frame: Frame, here: Bools, settle: Bools) -> None:
        """Take one step in, in which agents were `here`; the decision of some, `settle`, ends with it."""
        world, events = frame.world, frame.events
        add_rewards(
            self._terms,
            self._memory,
            self._served.seats,
            here,
            settle,
            world.seats.slot,
            world.seats.outcome,
            world.seats.remaining,
            world.missions.goal,
            world.missions.goal_position,
            world.vehicles.position,
            world.vehicles.lane_offset,
            events.bits,
            events.just_done,
            events.terminated,
            self.values,
        )

    def reset(self, agents: Bools) -> None:
        """Forget these agents, shape (B, G)."""
        for column in self._memory:
            column[agents] = 0
        self.values[agents] = 0.0
