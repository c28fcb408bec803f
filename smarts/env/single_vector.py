"""Gymnasium's `VectorEnv`: many simulations with one learning agent each, stepped together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.spec import AgentSpec
from smarts.arrays import Bools, Bytes, Floats
from smarts.env.groups import ALONE, assembled, space_of
from smarts.env.runner import NotCopied
from smarts.env.settings import EnvOptions, EnvSettings
from smarts.env.single import AGENT
from smarts.env.vector import VectorHiWayEnv
from smarts.env.vector_step import VectorStep
from smarts.observations.action_mask import MASK
from smarts.types.events import Outcome

Leaves = Mapping[str, NDArray]

_INVALID = Outcome.INVALID.name.lower()
_OUTCOMES = [outcome.name.lower() for outcome in Outcome if outcome != Outcome.NONE]


class SingleHiWayVectorEnv(NotCopied, VectorEnv):
    """What `gymnasium.make_vec("smarts.env:hiway-single-v0", num_envs, ...)` returns.

    A simulation is reset in the step in which its episode ends (`AutoresetMode.SAME_STEP`): the observation
    is the first of the next episode; `infos["final_obs"]` and `infos["final_info"]` hold its last
    observation, mask and outcome. Simulation i plays what world i of `VectorHiWayEnv` does, and simulation 0
    what `SingleHiWayEnv` does. If the traffic of a simulation fails, its episode is truncated with outcome
    "invalid", reward 0 and its previous observation as the last one.

    Args:
        num_envs: How many simulations.
        scenarios: Folders, or names of the suite; they are played in a seeded order.
        agent: Its spec (without adapters) or interface; by default, that of the benchmark.
        options: See `EnvSettings`; the mask of the lane actions is in the infos.

    Raises:
        SmartsError: A scenario or the agent is invalid.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int,
        scenarios: Sequence[str | Path],
        agent: AgentSpec | AgentInterface | None = None,
        **options: Unpack[EnvOptions],
    ) -> None:
        self.closed = True  # what `__del__` finds if the next lines raise
        agents = 1 if agent is None else {AGENT: agent}
        EnvSettings(scenarios, agents, num_envs, **options).refuse_bubbles()
        self._env = VectorHiWayEnv(num_envs, scenarios, agents, **options)
        self.num_envs = num_envs
        (block,) = self._env.spaces.blocks
        spaces = {name or ALONE: space for name, space in block.observation.items()}
        self.single_observation_space = space_of(assembled(spaces))
        self.single_action_space = block.action
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seen: Any = None
        self._mask: Bytes | None = None
        self.closed = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next episodes, or with a seed the first ones of that seed.

        Raises:
            SmartsError: `seed` is not a number.
        """
        played = [start.episode for start in self._env.episodes]
        first = 0 if seed is not None or not played else 1 + max(played)
        step = self._env.reset(seed, episode=first)
        super().reset(seed=seed, options=options)
        return self._take(step), self._infos(step, ~step.reset)

    def step(self, actions: ArrayLike) -> tuple[Any, Floats, Bools, Bools, dict[str, Any]]:
        """Step all simulations until the next decision; reset each simulation whose episode ends.

        Args:
            actions: An element of `action_space`.

        Raises:
            ActionError: An action is not in the space, or they are not an array of its shape.
            SmartsError: The environment was closed, or never reset.
        """
        step = self._env.step([actions])
        failed = np.zeros(self.num_envs, np.bool_)
        failed[[*step.failed]] = True
        final = self._final(step)
        seen, infos = self._take(step), self._infos(step, ~(step.reset | failed))
        for row, (observation, info) in final.items():
            infos = self._add_info(infos, {"final_obs": observation, "final_info": info}, row)
        rewards = step.rewards[:, 0].astype(np.float64)
        return seen, rewards, step.terminated[:, 0].copy(), step.truncated[:, 0] | failed, infos

    def close_extras(self, **_: Any) -> None:
        """Free the simulations."""
        self._env.close()

    def _mask_of(self, mask: Bools | None) -> Bytes | None:
        return None if mask is None else mask[:, 0].astype(np.int8)

    def _take(self, step: VectorStep) -> Any:
        """Keep the masks and observations of a step; return the observations."""
        self._mask = self._mask_of(step.masks[0])
        self._seen = _observations(step.observations[0])
        return self._seen

    def _infos(self, step: VectorStep, rows: Bools) -> dict[str, Any]:
        """Return all masks, and what is to be known of other agents in some simulations."""
        everywhere = np.ones(self.num_envs, np.bool_)
        infos = {} if self._mask is None else {MASK: self._mask, f"_{MASK}": everywhere}
        for row in np.flatnonzero(rows).tolist():
            infos = self._add_info(infos, _about_others(step, row), row)
        return infos

    def _final(self, step: VectorStep) -> dict[int, tuple[Any, dict[str, Any]]]:
        """Return the last observation and info of each simulation whose episode has ended, by row."""
        final: dict[int, tuple[Any, dict[str, Any]]] = {}
        for row in step.failed:
            final[row] = _pick(self._seen, row), _ended(step, row, _INVALID, self._mask, row)
        if step.final is not None:
            seen = _observations(step.final.observations[0])
            mask = self._mask_of(step.final.masks[0])
            for place, row in enumerate(step.final.rows.tolist()):
                outcome = next(each for each in _OUTCOMES if step.metrics[row][each])
                final[row] = _pick(seen, place), _ended(step, row, outcome, mask, place)
        return final


def _ended(step: VectorStep, row: int, outcome: str, masks: Bytes | None, place: int) -> dict[str, Any]:
    """Return the last info of a simulation, whose mask has a place among `masks`."""
    mask = {} if masks is None else {MASK: masks[place]}
    return {"outcome": outcome, **_about_others(step, row), **mask}


def _about_others(step: VectorStep, row: int) -> dict[str, Any]:
    """Return what is to be known of other agents in a simulation."""
    failures = {"social_failures": step.social_failures[row]} if row in step.social_failures else {}
    return failures | dict(step.social_infos.get(row, {}))


def _observations(leaves: Leaves) -> Any:
    """Return copies of arrays of shape (B or K, 1, ...) as one batch of observations."""
    return assembled({name or ALONE: array[:, 0].copy() for name, array in leaves.items()})


def _pick(observations: Any, row: int) -> Any:
    """Return one observation of a batch."""
    if isinstance(observations, Mapping):
        return {name: _pick(part, row) for name, part in observations.items()}
    return observations[row]
