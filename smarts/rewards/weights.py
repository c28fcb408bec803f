"""Rewards: weighted sums, with the weights in YAML."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from smarts.arrays import Bools, Singles
from smarts.errors import ScenarioError, nearest_names
from smarts.geometry.binding import bind
from smarts.observations.context import AdapterContext
from smarts.rewards.kernel import Memory, Terms, add_rewards
from smarts.types.events import Event, Events, Outcome
from smarts.types.frame import Frame

DECISIONS = 120
"""Over how many the cost of time is spread where there is no time limit."""

_FILE = Path(__file__).with_name("rewards.yaml")


@dataclass(frozen=True)
class RewardWeights:
    """The weights of a decision's reward. A weight is added (times what it weighs), so costs are negative."""

    discount: float = 0.99
    """By which the learner discounts one decision: shaping by a potential needs the same."""
    progress: float = 0.0
    """Of the potential's gain, discount * potential after - potential before. The potential is the share of
    the route that is left, negative, and 0 when the agent's episode has ended for good."""
    lane_change: float = 0.0
    """For each lane change that the route still demands, of three at most, as another part of the potential;
    it too is 0 at the end. Without it nothing penalises the wrong lane before the wrong exit."""
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
    neighbour_distance: float = 0.0
    """For each metre by which the mean distance to the eight nearest vehicles has become more."""
    time_to_collision: float = 0.0
    """For each second by which the mean time to collision with them has become more."""
    hard_steering: float = 0.0
    """For each step, times ((v - 60 km/h) / 20 km/h * steering [rad] / 4) ** 2 where v is above 60 km/h."""
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


Weights = str | RewardWeights | Mapping[str, float]
"""A name of `rewards.yaml`, or the weights themselves."""


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
    return _weights({**known[name], **changes}, f"{_FILE}: {name}")


def given_weights(weights: Weights) -> RewardWeights:
    """Return the weights that a name, a dict of terms, or weights themselves stand for.

    Raises:
        ScenarioError: There are no such weights, or there is no such term.
    """
    if isinstance(weights, RewardWeights):
        return weights
    if isinstance(weights, Mapping):
        return _weights(weights, "reward")
    if not isinstance(weights, str):
        raise ScenarioError(
            f"{weights!r} is not a reward",
            place="reward",
            remedy="give a name, a dict, or RewardWeights(...)",
        )
    return reward_weights(weights)


def _weights(chosen: Mapping[str, float], place: str) -> RewardWeights:
    terms = [field.name for field in dataclasses.fields(RewardWeights)]
    for term, weight in chosen.items():
        if term not in terms:
            raise ScenarioError(
                f"there is no reward term {term!r}",
                place=place,
                remedy=nearest_names(str(term), terms),
            )
        if not isinstance(weight, int | float) or not np.isfinite(weight):
            raise ScenarioError(f"{term} is {weight!r}, not a number", place=place)
    return RewardWeights(**chosen)


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
    shares = [weights.discount, weights.progress, weights.lane_change, weights.time / horizon]
    shares += [weights.each_step, weights.metres, weights.goal_distance, weights.approach, weights.centring]
    shares += [weights.neighbour_distance, weights.time_to_collision, weights.hard_steering]
    return Terms(
        by_outcome,
        np.array([*_EVENTS], np.int32),
        np.array([getattr(weights, name) for name in _EVENTS.values()]),
        np.array([Event.WRONG_WAY | Event.ON_SHOULDER], np.int32),
        np.array(shares),
    )


class _Adding(NamedTuple):
    """The kernel with the events that it is bound to."""

    events: Events
    add: Callable[..., None]


class Rewards:
    """The weighted rewards of some agents' decisions.

    Args:
        context: The agents.
        weights: Name of the weights in `rewards.yaml`, or the weights themselves, also as a dict.
        discount: Instead of that of the weights.

    Raises:
        ScenarioError: There are no such weights, or the discount is not in [0, 1].
    """

    def __init__(self, context: AdapterContext, weights: Weights, discount: float | None = None) -> None:
        self._context = context
        chosen = given_weights(weights)
        if discount is not None:
            chosen = dataclasses.replace(chosen, discount=discount)
        if not isinstance(chosen.discount, int | float | np.floating) or not 0.0 <= chosen.discount <= 1.0:
            raise ScenarioError(
                f"the discount is {chosen.discount!r}", place="reward", remedy="give the learner's, in [0, 1]"
            )
        horizon = context.max_steps / context.period if context.max_steps else DECISIONS
        self._terms = reward_terms(chosen, horizon)
        shape = context.scene.world.worlds, len(context.agents)
        self._memory = Memory.allocate(*shape)
        self.values: Singles = np.zeros(shape, np.float32)
        """Of the last decision, shape (B, G); those of agents that made none mean nothing."""
        self._has_decided = np.zeros(shape, np.bool_)
        self._adding: _Adding | None = None

    def collect(self, frame: Frame, is_last: bool) -> Bools:
        """Accumulate a step; return the agents whose decision ends with it, shape (B, G), until the next."""
        if self._adding is None or self._adding.events is not frame.events:
            self._adding = self._bind(frame.events)
        self._adding.add(frame.env_mask, is_last)
        return self._has_decided

    def reset(self, egos: Bools) -> None:
        """Begin episodes of some of the agents, shape (B, G)."""
        for column in self._memory:
            column[egos] = 0
        self.values[egos] = 0.0

    def _bind(self, events: Events) -> _Adding:
        """Bind the kernel to events, which a simulation writes into the same arrays in every step."""
        world = self._context.scene.world
        known = self._terms, self._memory, self._context.agent_ids
        state = world.agents, world.vehicles, world.missions, events
        return _Adding(events, bind(add_rewards, *known, *state, self._has_decided, self.values))
