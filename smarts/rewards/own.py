"""User-defined rewards: a function of one simulation step, batched over simulations and agents."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Bools, Bytes, Floats, Singles
from smarts.errors import OwnCodeError
from smarts.observations.context import AdapterContext
from smarts.registry import adopted, guarded, is_own_name
from smarts.rewards.weights import Rewards, RewardWeights, Weights, given_weights
from smarts.types.agent_states import UNSET
from smarts.types.events import Event
from smarts.types.frame import Frame

Reward = Weights | Callable[..., Any]
"""A reward: weights, a callable, or its `module:NAME`."""


@dataclass(frozen=True)
class RewardStep:
    """What happened to the agents in one simulation step.

    Arrays have the shape (B, n) of simulations and agents, and are copies. Entries of agents that are not
    `driving` are unspecified, and 0 without a vehicle.
    """

    frame: Frame
    """The whole step; `frame.world` holds every vehicle."""
    context: AdapterContext
    """The agents: names, `agent_ids`, scene."""
    driving: Bools
    """Which agents drove in this step, including agents whose episode ended in it."""

    @property
    def dt(self) -> float:
        """Length of the step [s]."""
        return self.frame.world.dt

    @property
    def position(self) -> Floats:
        """Centre of each agent's vehicle [m], shape (B, n, 2)."""
        return self._of_vehicles("position")

    @property
    def heading(self) -> Floats:
        """Counter-clockwise from +x [rad]."""
        return self._of_vehicles("heading")

    @property
    def speed(self) -> Floats:
        """Along the heading [m/s]."""
        return self._of_vehicles("speed")

    @property
    def acceleration(self) -> Floats:
        """Along the heading [m/s^2]."""
        return self._of_vehicles("acceleration")

    @property
    def lateral_acceleration(self) -> Floats:
        """Across the heading, positive to the left [m/s^2]."""
        return self._of_vehicles("lateral_acceleration")

    @property
    def lane_offset(self) -> Floats:
        """Distance from the lane's centreline, positive to the left [m]."""
        return self._of_vehicles("lane_offset")

    @property
    def remaining_distance(self) -> Floats:
        """Distance left on the route to the goal [m]; keeps its last value off the route."""
        return self._of_agents("remaining")

    @property
    def distance_travelled(self) -> Floats:
        """Distance driven since the agent entered [m]."""
        return self._of_agents("distance_travelled")

    @property
    def steering(self) -> Floats:
        """Angle of the front wheels, positive to the left [rad]."""
        return self._of_agents("steering")

    @property
    def ended(self) -> Bools:
        """Which agents' episodes ended with this step."""
        return self.context.ended(self.frame).copy()

    @property
    def outcome(self) -> Bytes:
        """How they ended: an `Outcome`, 0 for agents that still drive."""
        return np.where(self.ended, self._of_agents("outcome"), 0).astype(np.int8)

    def happened(self, event: Event) -> Bools:
        """Return which agents an event happened to in this step: `step.happened(Event.COLLISION)`."""
        return (self.frame.events.bits[:, self.context.agent_ids] & int(event)) != 0

    def _of_agents(self, name: str) -> NDArray:
        return getattr(self.frame.world.agents, name)[:, self.context.agent_ids]

    def _of_vehicles(self, name: str) -> Floats:
        slots = self._of_agents("slot")
        column = getattr(self.frame.world.vehicles, name)
        values = column[np.arange(len(slots))[:, None], np.maximum(slots, 0)]
        has_vehicle = (slots != UNSET).reshape(*slots.shape, *[1] * (values.ndim - 2))
        return np.where(has_vehicle, values, 0.0)


class OwnReward(Protocol):
    """A reward of the user's: a function, or a class that is made without arguments for each environment.

    A class may also have `weights`, a name of `rewards.yaml`, a dict of terms or `RewardWeights`: that reward
    is added; and `reset(self, agents)`, called with the agents that begin an episode, shape (B, n).
    """

    def __call__(self, step: RewardStep) -> ArrayLike:
        """Return each agent's reward of the step, shape (B, n).

        The reward of a decision is the sum over its steps. Values of agents that are not
        `step.driving` are ignored.
        """
        ...


class OwnRewards:
    """Adds an own reward up over decisions, as `Rewards` does weighted ones.

    Args:
        context: The agents.
        reward: The function, or the class.
        name: For errors.
        discount: Of the learner, for `weights` that the reward adds.

    Raises:
        OwnCodeError: The class cannot be made.
    """

    def __init__(
        self, context: AdapterContext, reward: Any, name: str, discount: float | None = None
    ) -> None:
        self._doing = f"the reward {name!r}"
        made = guarded(reward, self._doing)() if isinstance(reward, type) else reward
        weights: Weights = getattr(made, "weights", RewardWeights())
        self._weighted = Rewards(context, given_weights(weights), discount)
        self._call = guarded(made, self._doing)
        forget = getattr(made, "reset", None)
        self._forget = None if forget is None else guarded(forget, self._doing)
        self._context = context
        self.values: Singles = self._weighted.values
        """Rewards of the last decision, shape (B, n)."""
        self._sum = np.zeros(self.values.shape)
        self._has_begun = np.zeros(self.values.shape, np.bool_)

    def collect(self, frame: Frame, is_last: bool) -> Bools:
        """Accumulate a step; return the agents whose decision ends with it, shape (B, n), until the next."""
        has_decided = self._weighted.collect(frame, is_last)
        present = self._context.present(frame)
        # An agent in its first observation has made no decision yet.
        driving = present & self._has_begun
        self._has_begun |= present
        if driving.any():
            self._sum += np.where(driving, self._worth(RewardStep(frame, self._context, driving)), 0.0)
        rewarded = has_decided & driving
        self.values[rewarded] += self._sum[rewarded]
        self._sum[has_decided] = 0.0
        return has_decided

    def reset(self, egos: Bools) -> None:
        """Begin episodes of some of the agents, shape (B, n)."""
        self._weighted.reset(egos)
        self._sum[egos], self._has_begun[egos] = 0.0, False
        if self._forget is not None:
            self._forget(egos)

    def _worth(self, step: RewardStep) -> Floats:
        worth = np.asarray(self._call(step), np.float64)
        if worth.shape not in ((), self.values.shape):
            raise OwnCodeError(
                f"{self._doing} returns an array of shape {worth.shape}",
                remedy=f"return numbers of shape {self.values.shape}: simulations, agents; or a single one",
            )
        worth = np.broadcast_to(worth, self.values.shape)
        bad = ~np.isfinite(worth) & step.driving
        if bad.any():
            row, agent = np.argwhere(bad)[0].tolist()
            raise OwnCodeError(
                f"{self._doing} is {worth[row, agent]} for {self._context.agents[agent]!r}",
                remedy="return finite numbers for agents that are driving",
            )
        return worth


def make_rewards(
    context: AdapterContext, reward: Reward, discount: float | None = None
) -> Rewards | OwnRewards:
    """Return the rewards of some agents.

    Args:
        context: The agents.
        reward: Weights or a name of theirs; or an own reward, or `module:Class` of it.
        discount: Of the learner.

    Raises:
        ScenarioError: There are no such weights.
        OwnCodeError: The own reward cannot be imported, made or called.
    """
    if isinstance(reward, str) and is_own_name(reward):
        return OwnRewards(context, own_reward(reward), reward, discount)
    if callable(reward):
        return OwnRewards(context, reward, getattr(reward, "__qualname__", repr(reward)), discount)
    return Rewards(context, reward, discount)


def is_weighted(reward: Reward) -> bool:
    """Return whether a reward is a sum of weighted terms, not the user's own."""
    return not callable(reward) and not (isinstance(reward, str) and is_own_name(reward))


def own_reward(name: str) -> Any:
    """Import the reward that a `module:Class` names.

    Raises:
        OwnCodeError: It cannot be imported, or is no reward.
    """
    return adopted("reward", name, _adopt)


def check_reward(reward: Any) -> None:
    """Raise if a value is not a reward.

    Raises:
        ScenarioError: There are no such weights.
        OwnCodeError: The own reward cannot be imported, or is no reward.
    """
    if isinstance(reward, str) and is_own_name(reward):
        own_reward(reward)
    elif not callable(reward):
        given_weights(reward)


def _adopt(name: str, found: Any) -> Any:
    is_made = isinstance(found, type)
    if not callable(found) or (is_made and "__call__" not in dir(found)):
        raise ValueError("is neither a function of a RewardStep nor a class with a method '__call__'")
    return found
