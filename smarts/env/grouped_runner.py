"""The runner of an environment's groups of agents, and what its recordings tell of them beside their motion.

Axis letters: B simulations, E egos, G agents of a group.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools
from smarts.env.groups import AgentGroup, make_groups
from smarts.env.runner import SimulationRunner
from smarts.env.settings import EnvSettings
from smarts.observations.lists import feature_list
from smarts.rewards.own import is_weighted
from smarts.rewards.weights import Rewards, RewardWeights, given_weights
from smarts.sim.recorder import OBSERVED
from smarts.sim.recorders import Recorders
from smarts.types.frame import Frame

REWARD_TERM = "reward/"
"""Begins the names of annotations with terms of rewards."""


def make_runner(
    settings: EnvSettings, *, sees_objects: bool = False
) -> tuple[SimulationRunner, tuple[AgentGroup, ...]]:
    """Return the simulations of an environment, and its agents by groups.

    Recordings tell the terms of rewards, and the observations of the agents that are asked for.

    Args:
        settings: What the environment is made from.
        sees_objects: See `make_groups`.

    Raises:
        SmartsError: A scenario or an agent is not what it has to be.
    """
    assembly, groups = make_groups(settings, sees_objects=sees_objects)
    runner = SimulationRunner(
        assembly, [group.adapter for group in groups], period=settings.decision_interval
    )
    if runner.recorder is not None:
        specs, weights = settings.specs(), _weights(settings)
        for group in groups:
            # The terms of a reward that a spec's adapter makes are its own business.
            has_terms = ["reward" not in specs[name].own_adapters for name in group.agents]
            runner.note(AgentNotes(group, runner, runner.recorder, has_terms, weights))
    return runner, groups


class AgentNotes:
    """Adds to the record what the rewards of agents consist of, and what they observe where it is asked for.

    Args:
        group: The agents that have one adapter.
        runner: Runner of the environment.
        recorder: Its recorder.
        has_terms: Agents whose rewards are the weighted ones, shape (G,).
        weights: Weights of the reward; None: it is the user's own.
    """

    def __init__(
        self,
        group: AgentGroup,
        runner: SimulationRunner,
        recorder: Recorders,
        has_terms: Sequence[bool],
        weights: RewardWeights | None,
    ) -> None:
        self._group, self._runner, self._recorder = group, runner, recorder
        self._mask = np.zeros(runner.alive.shape, np.bool_)
        self._mask[:, group.columns] = has_terms
        self._terms = {} if weights is None or not any(has_terms) else _terms(group, weights)
        self._is_followed = np.zeros(runner.alive.shape, np.bool_)  # from the beginning of its episode
        self._follows = False  # any of them

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Accumulate a step of a decision."""
        if not self._follows:
            return
        if self._recorder.wants_terms:
            for term in self._terms.values():
                term.collect(frame, is_last)
        else:
            self._is_followed[:], self._follows = False, False

    def reset(self, egos: Bools) -> None:
        """Begin episodes of these egos, shape (B, E); their terms are followed if they are wanted now."""
        if self._terms:
            self._is_followed[egos] = self._recorder.wants_terms
            self._follows = bool(self._is_followed.any())
            for term in self._terms.values():
                term.reset(egos[:, self._group.agent_ids])

    def before_decision(self) -> None:
        """Record what the agents observe as they decide."""
        observers, columns = self._recorder.observers, self._group.columns
        if observers is None or not observers[:, columns].any():
            return
        wanted = np.zeros_like(self._runner.alive)
        wanted[:, columns] = observers[:, columns]
        for name, values in self._group.adapter.observations.items():
            flat = values.reshape(*values.shape[:2], -1)
            self._runner.annotate(f"{OBSERVED}{name}", self._wide(flat), wanted)

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
        wide[:, self._group.columns] = values
        return wide


def _weights(settings: EnvSettings) -> RewardWeights | None:
    """Return the weights of the environment's reward, None where it has none."""
    reward = feature_list(settings.observation).reward if settings.reward is None else settings.reward
    if settings.adapter is not None or not is_weighted(reward):
        return None
    weights = given_weights(reward)
    return weights if settings.discount is None else dataclasses.replace(weights, discount=settings.discount)


def _terms(group: AgentGroup, weights: RewardWeights) -> dict[str, Rewards]:
    """Return each term of some agents' weighted reward by itself; their sum is the reward."""
    given = {name: value for name, value in dataclasses.asdict(weights).items() if value}
    discount = given.pop("discount", 0.0)
    return {
        name: Rewards(group.context, RewardWeights(**{name: value, "discount": discount}))
        for name, value in given.items()
    }
