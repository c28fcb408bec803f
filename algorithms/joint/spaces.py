"""Conversion between Gymnasium's spaces and arrays: observation leaves, actions stored and sent."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete

from algorithms.errors import SpaceError
from algorithms.joint.env import Action, JointStep, map_arrays

MASK = "action_mask"
WRAPPED = ("observations", "observation", "obs")
"""Names under which environments with action masks put the observation proper."""


class Flattening:
    """How one agent's observation becomes leaves.

    Attributes:
        leaves: Space of each leaf; Discrete and its kin become one-hot vectors.
        arrays: Shape and type of each leaf.
        masked: Whether the observation carries an action mask.

    Raises:
        SpaceError: The space has a part that is neither Box, Discrete, MultiDiscrete, MultiBinary nor Dict.
    """

    def __init__(self, space: gym.Space, agent: str) -> None:
        self.leaves: dict[str, Box] = {}
        self._paths: list[tuple[str, tuple[str, ...], gym.Space]] = []
        self.masked = isinstance(space, Dict) and MASK in space.spaces
        self._inside: str | None = None
        if isinstance(space, Dict) and self.masked:
            rest = {name: part for name, part in space.spaces.items() if name != MASK}
            if len(rest) == 1 and next(iter(rest)) in WRAPPED:
                self._inside, space = next(iter(rest.items()))
            else:
                space = Dict(rest)
        self._collect(space, (), agent)
        self.arrays = {name: (leaf.shape, np.dtype(leaf.dtype)) for name, leaf in self.leaves.items()}
        self.plain = not self.masked and list(self.leaves) == [""] and isinstance(space, Box)

    def _collect(self, space: gym.Space, path: tuple[str, ...], agent: str) -> None:
        if isinstance(space, Dict):
            for name, part in space.spaces.items():
                self._collect(part, (*path, name), agent)
            return
        name = "/".join(path)
        if isinstance(space, Box):
            self.leaves[name] = space
        elif isinstance(space, Discrete | MultiDiscrete | MultiBinary):
            self.leaves[name] = Box(0, 1, (gym.spaces.flatdim(space),), np.float32)
        else:
            raise SpaceError(
                f"the observation part {name!r} of agent {agent!r} is {space}",
                place="observation space",
                remedy="use Box, Discrete, MultiDiscrete, MultiBinary or Dict of these",
            )
        self._paths.append((name, path, space))

    def split(self, observation: Any) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
        """Return (leaves, action mask or None) of one observation."""
        mask = observation[MASK] if self.masked else None
        if self._inside is not None:
            observation = observation[self._inside]
        leaves = {}
        for name, path, space in self._paths:
            part = observation
            for key in path:
                part = part[key]
            own = isinstance(space, Box)
            leaves[name] = part if own else np.asarray(gym.spaces.flatten(space, part), np.float32)
        return leaves, mask


def learned_space(space: Box) -> Box:
    """Return the space of an observation leaf as learners store it: floating-point numbers are float32."""
    if space.dtype is None or space.dtype.kind != "f" or space.dtype == np.float32:
        return space
    with np.errstate(over="ignore"):  # bounds beyond float32 are no bounds
        return Box(space.low.astype(np.float32), space.high.astype(np.float32), space.shape, np.float32)


def learned_step(step: JointStep) -> JointStep:
    """Return the step with float32 observations and states, whatever floats the environment gives."""
    final = step.final
    if final is not None:
        final = final._replace(
            observations=map_arrays(_learned, final.observations), state=map_arrays(_learned, final.state)
        )
    seen = map_arrays(_learned, step.observations)
    return step._replace(observations=seen, state=map_arrays(_learned, step.state), final=final)


def _learned(array: np.ndarray) -> np.ndarray:
    if array.dtype.kind != "f" or array.dtype == np.float32:
        return array
    with np.errstate(over="ignore"):  # what becomes infinite counts as a failure of the environment
        return array.astype(np.float32)


def check_action_space(space: gym.Space | None, agent: str) -> Action:
    """Return the space if agents can act in it.

    Raises:
        SpaceError: It is neither Discrete nor a Box.
    """
    if isinstance(space, Box | Discrete):
        return space
    raise SpaceError(
        f"agent {agent!r} has the action space {space}",
        place="action space",
        remedy="use Discrete or Box; flatten a MultiDiscrete into one Discrete",
    )


def stored_actions(space: Action, shape: tuple[int, ...]) -> np.ndarray:
    """Return zeros for actions as modules give them: int64 `shape`, or float32 `(*shape, k)`, flat."""
    if isinstance(space, Discrete):
        return np.zeros(shape, np.int64)
    return np.zeros((*shape, int(np.prod(space.shape))), np.float32)


def is_bounded(space: Box) -> bool:
    """Return whether modules act in [-1, 1] and are scaled to the bounds of the space."""
    return space.is_bounded("both")


def to_env(space: Action, actions: np.ndarray) -> np.ndarray:
    """Return module actions in the environment's units: shifted, or scaled and clipped.

    Every integer of a bounded Box of integers stands for an equal share of [-1, 1].
    """
    if isinstance(space, Discrete):
        return actions + space.start if space.start else actions
    actions = actions.reshape(*actions.shape[:-1], *space.shape)
    if np.issubdtype(space.dtype, np.integer):
        return _integers(space, actions.astype(np.float64))
    if is_bounded(space):
        actions = space.low + (np.clip(actions, -1, 1) + 1) * (space.high - space.low) / 2
    return np.clip(actions, space.low, space.high).astype(space.dtype)


def _integers(space: Box, actions: np.ndarray) -> np.ndarray:
    low, high = space.low.astype(np.float64), space.high.astype(np.float64)
    share = np.floor((actions + 1) / 2 * (high - low + 1))
    whole = low + share if is_bounded(space) else np.rint(actions)
    return np.clip(whole, low, high).astype(space.dtype)
