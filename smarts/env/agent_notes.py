"""What recordings tell of chosen agents beside their motion: features that they observe, terms of rewards.

Axis letters: B simulations, E egos, G agents of a group.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools
from smarts.env.groups import AgentGroup
from smarts.env.runner import SimulationRunner
from smarts.env.settings import EnvSettings
from smarts.observations.context import AdapterContext
from smarts.observations.lists import feature_list
from smarts.rewards.own import is_weighted
from smarts.rewards.weights import Rewards, RewardWeights, given_weights
from smarts.sim.recorder import OBSERVED
from smarts.types.frame import Frame

REWARD_TERM = "reward/"
"""Begins the names of annotations with terms of rewards."""


class RewardTerms:
    """Each term of some agents' weighted reward by itself; their sum is the reward.

    Args:
        context: The agents.
        weights: Of the reward.
    """

    def __init__(self, context: AdapterContext, weights: RewardWeights) -> None:
        given = {name: value for name, value in dataclasses.asdict(weights).items() if value}
        discount = given.pop("discount", 0.0)
        self._parts = {
            name: Rewards(context, RewardWeights(**{name: value, "discount": discount}))
            for name, value in given.items()
        }

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Accumulate a step of a decision."""
        for part in self._parts.values():
            part.collect(frame, is_last)

    def reset(self, egos: Bools) -> None:
        """Begin episodes of some of the agents, shape (B, G)."""
        for part in self._parts.values():
            part.reset(egos)

    @property
    def values(self) -> dict[str, NDArray]:
        """Terms of the last decision by name, shape (B, G) each."""
        return {name: part.values for name, part in self._parts.items()}


class RewardNotes:
    """Adds to the record what the rewards of chosen agents consist of.

    Args:
        context: Of some egos.
        runner: Of the environment.
        columns: Of these egos.
        is_chosen: Which of them are chosen, shape (G,).
        weights: Of the reward; None: it is the user's own.
    """

    def __init__(
        self,
        context: AdapterContext,
        runner: SimulationRunner,
        columns: slice,
        is_chosen: Sequence[bool],
        weights: RewardWeights | None,
    ) -> None:
        self._agent_ids, self._columns, self._runner = context.agent_ids, columns, runner
        self._mask = np.zeros(runner.alive.shape, np.bool_)
        self._mask[:, columns] = is_chosen
        self._terms = None if weights is None else RewardTerms(context, weights)

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Accumulate a step of a decision."""
        if self._terms is not None:
            self._terms.collect(frame, is_last)

    def reset(self, egos: Bools) -> None:
        """Begin episodes of these egos, shape (B, E)."""
        if self._terms is not None:
            self._terms.reset(egos[:, self._agent_ids])

    def before_decision(self) -> None:
        """Do nothing: rewards come after decisions."""

    def rewards(self) -> dict[str, NDArray]:
        """Return the terms of the last decision by the names of annotations, shape (B, E) each."""
        terms = {} if self._terms is None else self._terms.values
        return {f"{REWARD_TERM}{name}": self._wide(values) for name, values in terms.items()}

    @property
    def mask(self) -> Bools:
        """The agents, shape (B, E)."""
        return self._mask

    def _wide(self, values: NDArray) -> NDArray:
        """Return values of the group's agents as values of all egos, 0 elsewhere."""
        wide = np.zeros((*self._mask.shape, *values.shape[2:]))
        wide[:, self._columns] = values
        return wide


class AgentNotes(RewardNotes):
    """Adds to the record what chosen agents observe, too.

    Args:
        group: The agents that have one adapter.
        runner: Of the environment.
        chosen: Names of the agents.
        weights: Of the reward; None: it is the user's own.
    """

    def __init__(
        self,
        group: AgentGroup,
        runner: SimulationRunner,
        chosen: Sequence[str],
        weights: RewardWeights | None,
    ) -> None:
        super().__init__(
            group.context, runner, group.columns, [name in chosen for name in group.agents], weights
        )
        self._adapter = group.adapter

    def before_decision(self) -> None:
        """Record what the agents observe as they decide."""
        for name, values in self._adapter.observations.items():
            flat = values.reshape(*values.shape[:2], -1)
            self._runner.annotate(f"{OBSERVED}{name}", self._wide(flat), self._mask)


def note_agents(runner: SimulationRunner, groups: Sequence[AgentGroup], settings: EnvSettings) -> None:
    """Have the agents of `Options.record_observations` recorded in full."""
    chosen = settings.simulation.record_observations if settings.simulation is not None else ()
    for group in groups:
        if set(chosen) & set(group.agents):
            runner.note(AgentNotes(group, runner, chosen, _weights(settings)))


def _weights(settings: EnvSettings) -> RewardWeights | None:
    """Return the weights of the environment's reward, None where it has none."""
    if settings.adapter is not None:
        return None
    features = feature_list(settings.observation)
    reward = features.reward if settings.reward is None else settings.reward
    if callable(reward) or not is_weighted(reward):
        return None
    weights = given_weights(reward)
    return weights if settings.discount is None else dataclasses.replace(weights, discount=settings.discount)
