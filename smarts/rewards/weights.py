"""Rewards: weighted sums, with the weights in YAML."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

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
"""Decisions over which the cost of time is spread if there is no time limit."""

_FILE = Path(__file__).with_name("rewards.yaml")


@dataclass(frozen=True)
class RewardWeights:
    """The weights of a decision's reward, the sum of weight * term; penalties have negative weights."""

    discount: float = 0.99
    """The learner's discount per decision; potential-based shaping must use the same."""
    progress: float = 0.0
    """Weight of the potential's gain, discount * potential after - potential before. The potential is minus
    the share of the route that remains, and 0 after termination. Without a goal there is no potential: every
    100 m along the lanes are worth `progress` + `goal`, as a mission of that length is."""
    lane_change: float = 0.0
    """Per lane change that the route still needs, three at most; part of the potential, so 0 after
    termination. Without this term, the wrong lane costs nothing until the exit is missed."""
    time: float = 0.0
    """Total of an episode that runs to the time limit."""
    each_step: float = 0.0
    """Per step."""
    metres: float = 0.0
    """Per metre along the route, without a goal along the lanes; on the road only."""
    goal_distance: float = 0.0
    """Per step and metre of straight-line distance to the goal, measured at the decision's end."""
    approach: float = 0.0
    """Per metre that this distance decreases."""
    centring: float = 0.0
    """Per metre that the distance to the lane's centre decreases."""
    neighbour_distance: float = 0.0
    """Per metre that the mean distance to the eight nearest vehicles increases."""
    time_to_collision: float = 0.0
    """Per second that the mean time to collision with them increases."""
    hard_steering: float = 0.0
    """Per step, times ((v - 60 km/h) / 20 km/h * steering [rad] / 4) ** 2 if v is above 60 km/h."""
    goal: float = 0.0
    collision: float = 0.0
    off_road: float = 0.0
    off_route: float = 0.0
    missed_goal: float = 0.0
    not_moving: float = 0.0
    time_out: float = 0.0
    wrong_way: float = 0.0
    """Per decision with the event; so are the weights above if the event does not end the episode."""
    on_shoulder: float = 0.0


Weights = str | RewardWeights | Mapping[str, float]
"""A name of `rewards.yaml`, or the weights themselves."""


def reward_weights(name: str = "benchmark", **changes: float) -> RewardWeights:
    """Return weights of `rewards.yaml`, with some of them changed.

    Raises:
        ScenarioError: There are no such weights; the remedy names the nearest.
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
                f"there is no reward term {term!r}", place=place, remedy=nearest_names(str(term), terms)
            )
        if not isinstance(weight, int | float) or not np.isfinite(weight):
            raise ScenarioError(f"{term} is {weight!r}, not a number", place=place)
    return RewardWeights(**chosen)


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
    arrays = {
        "by_outcome": np.array([getattr(weights, outcome.name.lower(), 0.0) for outcome in Outcome]),
        "event": np.array([*_EVENTS], np.int32),
        "by_event": np.array([getattr(weights, name) for name in _EVENTS.values()]),
        "always": np.array([Event.WRONG_WAY | Event.ON_SHOULDER], np.int32),
    }
    single = {name: float(getattr(weights, name)) for name in Terms._fields if name not in arrays}
    return Terms(**{**single, "time": float(weights.time / horizon)}, **arrays)


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
        if not 0.0 <= chosen.discount <= 1.0:
            remedy = "give the learner's, in [0, 1]"
            raise ScenarioError(f"the discount is {chosen.discount!r}", place="reward", remedy=remedy)
        horizon = context.max_steps / context.period if context.max_steps else DECISIONS
        self._terms = reward_terms(chosen, horizon)
        shape = context.scene.world.worlds, len(context.agents)
        self._memory = Memory.allocate(*shape)
        self.values: Singles = np.zeros(shape, np.float32)
        """Rewards of the last decision, shape (B, G); entries of agents that made none are unspecified."""
        self._has_decided = np.zeros(shape, np.bool_)
        self._events: Events | None = None

    def collect(self, frame: Frame, is_last: bool) -> Bools:
        """Accumulate a step; return the agents whose decision ends with it, shape (B, G), until the next."""
        if self._events is not frame.events:
            # A simulation writes them into the same arrays in every step.
            self._events, world = frame.events, self._context.scene.world
            known = self._terms, self._memory, world.state, self._context.agent_ids
            self._add = bind(add_rewards, *known, self._events, self._has_decided, self.values)
        self._add(frame.env_mask, is_last)
        return self._has_decided

    def reset(self, egos: Bools) -> None:
        """Begin episodes of some of the agents, shape (B, G)."""
        for column in self._memory:
            column[egos] = 0
        self.values[egos] = 0.0
