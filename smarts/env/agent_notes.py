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


class RewardNotes:
    """Adds to the record what the rewards of agents consist of.

    Args:
        context: Context of some egos.
        runner: Runner of the environment.
        columns: Columns of these egos.
        has_terms: Agents whose rewards are the weighted ones, shape (G,).
        weights: Weights of the reward; None: it is the user's own.
    """

    def __init__(
        self,
        context: AdapterContext,
        runner: SimulationRunner,
        columns: slice,
        has_terms: Sequence[bool],
        weights: RewardWeights | None,
    ) -> None:
        self._agent_ids, self._columns, self._runner = context.agent_ids, columns, runner
        self._mask = np.zeros(runner.alive.shape, np.bool_)
        self._mask[:, columns] = has_terms
        self._terms = _terms(context, weights) if weights is not None and any(has_terms) else {}
        self._is_followed = np.zeros(runner.alive.shape, np.bool_)  # from the beginning of its episode
        self._follows = False  # any of them

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Accumulate a step of a decision."""
        if not self._follows:
            return
        if self._runner.wants_terms:
            for term in self._terms.values():
                term.collect(frame, is_last)
        else:
            self._is_followed[:], self._follows = False, False

    def reset(self, egos: Bools) -> None:
        """Begin episodes of these egos, shape (B, E); their terms are followed if they are wanted now."""
        if self._terms:
            self._is_followed[egos] = self._runner.wants_terms
            self._follows = bool(self._is_followed.any())
            for term in self._terms.values():
                term.reset(egos[:, self._agent_ids])

    def before_decision(self) -> None:
        """Do nothing: rewards come after decisions."""

    def rewards(self) -> dict[str, NDArray]:
        """Return the terms of the last decision by the names of annotations, shape (B, E) each."""
        terms = self._terms if self._follows else {}
        return {f"{REWARD_TERM}{name}": self._wide(term.values) for name, term in terms.items()}

    @property
    def mask(self) -> Bools:
        """The agents with terms, shape (B, E)."""
        return self._mask & self._is_followed

    def _wide(self, values: NDArray) -> NDArray:
        """Return values of the group's agents as values of all egos, 0 elsewhere."""
        wide = np.zeros((*self._mask.shape, *values.shape[2:]))
        wide[:, self._columns] = values
        return wide


class AgentNotes(RewardNotes):
    """Adds to the record what agents observe, too, where it is asked for.

    Args:
        group: The agents that have one adapter.
        runner: Runner of the environment.
        has_terms: See `RewardNotes`.
        weights: See `RewardNotes`.
    """

    def __init__(
        self,
        group: AgentGroup,
        runner: SimulationRunner,
        has_terms: Sequence[bool],
        weights: RewardWeights | None,
    ) -> None:
        super().__init__(group.context, runner, group.columns, has_terms, weights)
        self._adapter = group.adapter
        self._group = np.zeros(runner.alive.shape, np.bool_)
        self._group[:, group.columns] = True

    def before_decision(self) -> None:
        """Record what the agents observe as they decide."""
        observers = self._runner.observers
        if observers is None:
            return
        wanted = observers & self._group
        if not wanted.any():
            return
        for name, values in self._adapter.observations.items():
            flat = values.reshape(*values.shape[:2], -1)
            self._runner.annotate(f"{OBSERVED}{name}", self._wide(flat), wanted)


def note_agents(runner: SimulationRunner, groups: Sequence[AgentGroup], settings: EnvSettings) -> None:
    """Have the terms of rewards recorded, and the observations of the agents that are asked for.

    An environment that is neither recorded nor shown has no notes.
    """
    if not runner.is_recorded:
        return
    specs, weights = settings.specs(), _weights(settings)
    for group in groups:
        # The terms of a reward that a spec's adapter makes are its own business.
        has_terms = ["reward" not in specs[name].own_adapters for name in group.agents]
        runner.note(AgentNotes(group, runner, has_terms, weights))


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


def _terms(context: AdapterContext, weights: RewardWeights) -> dict[str, Rewards]:
    """Return each term of some agents' weighted reward by itself; their sum is the reward."""
    given = {name: value for name, value in dataclasses.asdict(weights).items() if value}
    discount = given.pop("discount", 0.0)
    return {
        name: Rewards(context, RewardWeights(**{name: value, "discount": discount}))
        for name, value in given.items()
    }
