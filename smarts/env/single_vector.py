"""Gymnasium's `VectorEnv`: many simulations with one learning agent each, stepped together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.spec import AgentSpec
from smarts.arrays import Bools, Bytes, Floats
from smarts.controllers.action_formats import rejection
from smarts.env.groups import ALONE, assembled, space_of
from smarts.env.runner import NotCopied
from smarts.env.settings import EnvOptions, EnvSettings, make_settings, refuse_bubbles, with_mask
from smarts.env.single import AGENT
from smarts.env.vector import VectorHiWayEnv
from smarts.env.vector_step import VectorStep
from smarts.errors import SmartsError
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
        action_mask: Whether observations hold the mask of the lane actions too, which is in the infos.
        options: See `EnvSettings`.

    Raises:
        SmartsError: A scenario or the agent is invalid.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int,
        scenarios: Sequence[str | Path],
        agent: AgentSpec | AgentInterface | None = None,
        *,
        action_mask: bool = False,
        **options: Unpack[EnvOptions],
    ) -> None:
        self.closed = True  # what `__del__` finds if the next lines raise
        agents = 1 if agent is None else {AGENT: agent}
        refuse_bubbles(
            "SingleHiWayVectorEnv", make_settings("SingleHiWayVectorEnv", scenarios, agents, options=options)
        )
        if action_mask:
            options["observation"] = with_mask(options.get("observation", EnvSettings.observation))
        self._env = VectorHiWayEnv(num_envs, scenarios, agents, **options)
        self.num_envs = num_envs
        (block,) = self._env.spaces.blocks
        self._shows_mask = action_mask and block.masked
        spaces: dict[str, Any] = {name or ALONE: space for name, space in block.observation.items()}
        if self._shows_mask and isinstance(block.action, Discrete):
            spaces[MASK] = Box(0, 1, (int(block.action.n),), np.int8)
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
            SmartsError: `seed` is not a number, or only some simulations are to be reset.
        """
        if "reset_mask" in (options or {}):
            remedy = "leave it out: simulations reset themselves"
            raise SmartsError("reset_mask is given", place="reset", remedy=remedy)
        played = [start.episode for start in self._env.episodes]
        first = 0 if seed is not None or not played else 1 + max(played)
        step = self._env.reset(seed, episode=first)
        super().reset(seed=seed, options=options)
        self._seen = self._observations(step.observations[0], step.masks[0])
        self._mask = self._mask_of(step.masks[0])
        return self._seen, self._infos() | self._social_infos(step, ~step.reset)

    def step(self, actions: ArrayLike) -> tuple[Any, Floats, Bools, Bools, dict[str, Any]]:
        """Step all simulations until the next decision; reset each simulation whose episode ends.

        Args:
            actions: An element of `action_space`.

        Raises:
            ActionError: An action is not in the space, or they are not an array of its shape.
            SmartsError: The environment was closed, or never reset.
        """
        step = self._env.step([self._checked(actions)[:, None]])
        failed = np.zeros(self.num_envs, np.bool_)
        failed[[*step.failed]] = True
        is_over = step.reset.any() or failed.any()
        final_infos = self._final_infos(step, failed) if is_over else {}
        self._seen = self._observations(step.observations[0], step.masks[0])
        self._mask = self._mask_of(step.masks[0])
        infos = self._infos() | self._social_infos(step, ~(step.reset | failed)) | final_infos
        rewards = step.rewards[:, 0].astype(np.float64)
        return self._seen, rewards, step.terminated[:, 0].copy(), step.truncated[:, 0] | failed, infos

    def close_extras(self, **_: Any) -> None:
        """Free the simulations."""
        self._env.close()

    def _checked(self, actions: ArrayLike) -> NDArray:
        try:
            values = np.asarray(actions)
        except ValueError:  # its rows are of different lengths
            values = np.empty(0)
        if values.shape != self.action_space.shape:
            remedy = f"give an array of shape {self.action_space.shape}, such as action_space.sample()"
            raise rejection(actions, f"is not an action of each of {self.num_envs}", "actions", remedy)
        return values

    def _observations(self, leaves: Leaves, mask: Bools | None) -> Any:
        """Return copies of arrays of shape (B or K, 1, ...) as one batch of observations."""
        parts = {name or ALONE: array[:, 0].copy() for name, array in leaves.items()}
        if self._shows_mask and mask is not None:
            parts[MASK] = mask[:, 0].astype(np.int8)
        return assembled(parts)

    def _mask_of(self, mask: Bools | None) -> Bytes | None:
        return None if mask is None else mask[:, 0].astype(np.int8)

    def _infos(self) -> dict[str, Any]:
        everywhere = np.ones(self.num_envs, np.bool_)
        return {} if self._mask is None else {MASK: self._mask, f"_{MASK}": everywhere}

    def _social_infos(self, step: VectorStep, rows: Bools) -> dict[str, Any]:
        """Return what is to be known of other agents in some simulations, laid out by gymnasium's rules."""
        infos: dict[str, Any] = {}
        for row in np.flatnonzero(rows).tolist():
            failures = {"social_failures": step.social_failures[row]} if row in step.social_failures else {}
            for name, value in {**failures, **step.social_infos.get(row, {})}.items():
                values = infos.setdefault(name, np.full(self.num_envs, None, object))
                is_given = infos.setdefault(f"_{name}", np.zeros(self.num_envs, np.bool_))
                values[row], is_given[row] = value, True
        return infos

    def _final_infos(self, step: VectorStep, failed: Bools) -> dict[str, Any]:
        """Return last observations, masks and outcomes, laid out as by `gymnasium.vector.SyncVectorEnv`."""
        observations = np.full(self.num_envs, None, object)
        outcomes = np.full(self.num_envs, None, object)
        masks = None if self._mask is None else np.where(failed[:, None], self._mask, np.int8(0))
        for row in np.flatnonzero(failed).tolist():
            observations[row], outcomes[row] = _pick(self._seen, row), _INVALID
        if step.final is not None:
            ended = self._observations(step.final.observations[0], step.final.masks[0])
            last = self._mask_of(step.final.masks[0])
            if masks is not None and last is not None:
                masks[step.final.rows] = last
            for place, row in enumerate(step.final.rows.tolist()):
                shares = step.metrics[row]
                observations[row] = _pick(ended, place)
                outcomes[row] = next(each for each in _OUTCOMES if shares[each])
        over = step.reset | failed
        final_info = {"outcome": outcomes, "_outcome": over} | self._social_infos(step, over)
        if masks is not None:
            final_info |= {MASK: masks, f"_{MASK}": over.copy()}
        return {
            "final_obs": observations,
            "_final_obs": over,
            "final_info": final_info,
            "_final_info": over.copy(),
        }


def _pick(observations: Any, row: int) -> Any:
    """Return one observation of a batch."""
    if isinstance(observations, Mapping):
        return {name: _pick(part, row) for name, part in observations.items()}
    return observations[row]
