"""Array adapters: the observations and rewards of some agents, as environments use them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import InterfaceError
from smarts.arrays import Bools, Singles
from smarts.observations.arrays import ArrayObservation
from smarts.observations.context import AdapterContext
from smarts.observations.lists import Observed, feature_list
from smarts.registry import adopted, is_own_name
from smarts.rewards.own import Reward, make_rewards
from smarts.types.frame import Frame
from smarts.types.interface import Field


class ArrayAdapter(Protocol):
    """Observations and rewards of some egos of all simulations at once, by kernels: no Python for each agent.

    A decision lasts several steps, each of which the adapter gets as a frame. Sums over agents or time are
    taken in a fixed order (kernels, not numpy reductions, whose order depends on B). An adapter is made by a
    call with an `AdapterContext`, the environment's `observation`, `reward` and `discount`, and the
    environment's `adapter_options` by name.
    """

    sensors: ClassVar[Collection[str] | None]
    """Names of the agents' sensors whose readings in the frame it uses; None: all."""
    fields: tuple[Field, ...]
    """The observation of one agent. A field `action_mask` says which discrete actions are allowed."""

    def collect(self, frame: Frame, is_last: bool) -> object:
        """Process one step of a decision, or a reset; `is_last` if the decision ends with it."""
        ...

    def reset(self, egos: Bools) -> None:
        """Begin episodes of these egos, shape (B, N); their observations become zero."""
        ...

    @property
    def observations(self) -> Mapping[str, NDArray]:
        """Array of each field, shape (B, G, *shape); an agent that ended keeps its last until the reset."""
        ...

    @property
    def rewards(self) -> Singles:
        """Rewards of the decision, shape (B, G)."""
        ...


Adapter = str | Callable[..., ArrayAdapter]
"""A class or function that makes an `ArrayAdapter`, or its "module:Class"."""


class ObservationAndReward:
    """The `ArrayAdapter` of an observation, which is a list of features, and a reward.

    Args:
        context: The agents.
        observation: A name of `observations.yaml`, a list or dict of features, or a `FeatureList`.
        reward: A name of `rewards.yaml`, the weights themselves, also as a dict; an own reward
            (`smarts.rewards.own`), or its `module:Class`. By default the reward of the observation.
        discount: Discount of the learner for a decision, if it is not that of the weights.

    Raises:
        SmartsError: There is no such feature, option or reward.
        OwnCodeError: A feature or the reward is the user's own and raises.
    """

    sensors: ClassVar[Collection[str] | None] = ()

    def __init__(
        self,
        context: AdapterContext,
        observation: Observed = "benchmark",
        reward: Reward | None = None,
        discount: float | None = None,
    ) -> None:
        features = feature_list(observation)
        self._context = context
        self._rewards = make_rewards(context, features.reward if reward is None else reward, discount)
        seen = ArrayObservation(context, features)
        self._observed = [seen]
        self.fields = seen.fields
        self.observations: Mapping[str, NDArray] = seen.arrays
        self.rewards = self._rewards.values

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Accumulate a step's reward, and observe the agents whose decision ends with it."""
        has_decided = self._rewards.collect(frame, is_last)
        if np.count_nonzero(has_decided):
            for each in self._observed:
                each.observe(has_decided)

    def reset(self, egos: Bools) -> None:
        """Begin episodes of these egos, shape (B, N)."""
        agents = egos[:, self._context.agent_ids]
        self._rewards.reset(agents)
        for each in self._observed:
            each.reset(agents)


def adapter_class(adapter: Adapter | None, options: Mapping[str, Any] | None = None) -> Callable[..., Any]:
    """Return what makes adapters: `ObservationAndReward`, unless the caller gives an adapter.

    Args:
        adapter: The caller's.
        options: Its keywords.

    Raises:
        InterfaceError: The adapter is no `module:Class`, or there are options without one.
        OwnCodeError: A `module:Class` is not importable, or lacks a method.
    """
    if adapter is None:
        if options:
            raise InterfaceError(
                f"adapter_options is {options!r}, and adapter is not given",
                place="adapter_options",
                remedy="give observation=... and reward=... themselves",
            )
        return ObservationAndReward
    make: Any = adapter
    if isinstance(adapter, str):
        if not is_own_name(adapter):
            raise InterfaceError(
                f"adapter is {adapter!r}, not a 'module:Class'",
                place="adapter",
                remedy=f"give observation={adapter!r}, or an adapter of your own (smarts/env/adapters.py)",
            )
        make = adopted("adapter", adapter, _adopt)
    return make


def _adopt(name: str, found: Any) -> Any:
    """Return a user's adapter: a class with the methods of `ArrayAdapter`, or a function that makes one."""
    missing = [each for each in ("collect", "reset") if not callable(getattr(found, each, None))]
    if isinstance(found, type) and missing:
        raise ValueError(
            f"has no method {missing[0]!r}: see smarts/env/adapters.py, or derive it from "
            "ObservationAndReward"
        )
    return found
