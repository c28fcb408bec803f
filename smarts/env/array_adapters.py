"""The array adapters: an observation, which is a list of features, and a reward."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar

import numpy as np

from smarts.agents.checks import check_truth
from smarts.agents.interface import AgentInterface
from smarts.arrays import Bools
from smarts.observations.arrays import ArrayObservation
from smarts.observations.context import AdapterContext
from smarts.observations.lists import Observed, feature_list
from smarts.rewards.own import Reward, make_rewards
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

    sensors: ClassVar[Collection[str] | None] = ()

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


class BenchmarkAdapter(ObservationAndReward):
    """The benchmark's observation, or another list of features, perhaps with a picture; its reward.

    Args:
        context: The agents.
        interface: Of the agents.
        observation: See `ObservationAndReward`.
        reward: See `ObservationAndReward`.
        discount: See `ObservationAndReward`.
        image: Whether there is a grey picture from above, "image", beside the vector "observation".
        image_size: Its rows and columns.
        image_resolution: Side of its pixels [m].
    """

    def __init__(
        self,
        context: AdapterContext,
        interface: AgentInterface,
        *,
        observation: Observed = "benchmark",
        reward: Reward = "benchmark",
        discount: float | None = None,
        image: bool = False,
        image_size: int = 64,
        image_resolution: float = 1.0,
    ) -> None:
        check_truth("image", image, "the adapter's options")
        features = feature_list(observation)
        if image:
            features = features.plus([{"image": {"size": image_size, "resolution": image_resolution}}])
        super().__init__(context, features, reward, discount)


class PaperAdapter(ObservationAndReward):
    """The paper's observation and reward."""

    def __init__(
        self,
        context: AdapterContext,
        interface: AgentInterface,
        *,
        reward: Reward = "paper",
        discount: float | None = None,
    ) -> None:
        super().__init__(context, "paper", reward, discount)


class RawAdapter(ObservationAndReward):
    """Every field of the agents' sensors, and metres of the route as reward."""

    needs_equal_sensors: ClassVar[bool] = True

    def __init__(
        self,
        context: AdapterContext,
        interface: AgentInterface,
        *,
        reward: Reward = "route_metres",
        discount: float | None = None,
    ) -> None:
        super().__init__(context, "raw", reward, discount)
