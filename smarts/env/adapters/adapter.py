"""Observations and rewards of some agents, as environments use them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray

from smarts.agents.checks import check_truth
from smarts.arrays import Bools
from smarts.env.adapters.actions import action_space, encode_array
from smarts.observations.arrays import ArrayObservation
from smarts.observations.context import AdapterContext
from smarts.observations.lists import Observed, feature_list
from smarts.rewards.own import Reward, make_rewards
from smarts.types.actions import Actions
from smarts.types.frame import Frame


class ObservationAndReward:
    """An `ArrayAdapter` of an observation and a reward.

    Args:
        context: The agents.
        observation: A name of `observations.yaml`, a dict, or a `FeatureList`.
        reward: Name of the weights in `rewards.yaml`, the weights themselves, also as a dict; or an own
            reward (`smarts.rewards.own`), or `module:Class` of it.
        discount: By which the learner discounts a decision, if not as in the weights.
    """

    def __init__(
        self,
        context: AdapterContext,
        observation: Observed,
        reward: Reward,
        discount: float | None = None,
    ) -> None:
        self._context = context
        self._rewards = make_rewards(context, reward, discount)
        self._observation = ArrayObservation(context, observation)
        self.fields = self._observation.fields
        self.observations = self._observation.arrays
        self.rewards = self._rewards.values
        self.action_space: Space = action_space(context.action)

    def encode(self, given: NDArray, chosen: Bools, out: Actions) -> None:
        """Write the agents' actions, shape (B, G, ...)."""
        encode_array(self._context, given, chosen, out)

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Accumulate a step's reward, and observe the agents whose decision ends with it."""
        has_decided = self._rewards.collect(frame, is_last)
        if np.count_nonzero(has_decided):
            self._observation.observe(has_decided)

    def reset(self, egos: Bools) -> None:
        """Begin episodes of these egos, shape (B, N)."""
        agents = egos[:, self._context.agent_ids]
        self._rewards.reset(agents)
        self._observation.reset(agents)


def benchmark(
    context: AdapterContext,
    interface: Any = None,
    *,
    observation: Observed = "benchmark",
    reward: Reward = "benchmark",
    discount: float | None = None,
    image: bool = False,
    image_size: int = 64,
    image_resolution: float = 1.0,
) -> ObservationAndReward:
    """Return the benchmark's observation, or another list of features, and reward, perhaps with a picture."""
    check_truth("image", image, "the adapter's options")
    features = feature_list(observation)
    if image:
        features = features.plus([{"image": {"size": image_size, "resolution": image_resolution}}])
    return ObservationAndReward(context, features, reward, discount)


def paper(
    context: AdapterContext,
    interface: Any = None,
    *,
    reward: Reward = "paper",
    discount: float | None = None,
) -> ObservationAndReward:
    """Return the paper's observation and reward."""
    return ObservationAndReward(context, "paper", reward, discount)


def raw(
    context: AdapterContext,
    interface: Any = None,
    *,
    reward: Reward = "route_metres",
    discount: float | None = None,
) -> ObservationAndReward:
    """Return the agents' readings, and metres of the route as reward."""
    return ObservationAndReward(context, "raw", reward, discount)
