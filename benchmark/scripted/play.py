"""Plays scripted policies."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete, Space
from numpy.typing import NDArray

from benchmark.scripted import SCRIPTED_POLICIES, ScriptedPolicy
from smarts.env.vector import VectorHiWayEnv, VectorStep
from smarts.errors import OwnCodeError, TrafficError, shown
from smarts.registry import definition_of, guarded, is_own_name
from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart


def episodes_of(
    env: VectorHiWayEnv, policy: str, seed: int, first_episode: int
) -> Generator[Mapping[str, float]]:
    """Yield the metrics of one episode of each world in turn, with every agent driven by a policy.

    Args:
        env: One simulation whose observations and actions fit the policy.
        policy: A name of `SCRIPTED_POLICIES`, or `module:Class` of a user's own.
        seed: Seed of the run.
        first_episode: The world of the first episode.

    Raises:
        TrafficError: Traffic failed.
    """
    drivers = ScriptedDrivers(policy, env)
    now = env.reset(seed, np.array([first_episode]), stride=1)
    (start,) = drivers.begin(np.ones(1, np.bool_))
    while True:
        now = env.step(drivers.act(now, now.alive))
        for error in now.failed.values():
            place = f"{start.scenario}, world {start.world}"
            raise TrafficError("the traffic failed", place=place) from error
        for shares in now.metrics.values():
            yield shares
            (start,) = drivers.begin(np.ones(1, np.bool_))


class ScriptedDrivers:
    """A scripted policy for each agent of each simulation of an environment.

    Args:
        policy: A name of `SCRIPTED_POLICIES`, or `module:Class` of a user's own.
        env: Its observations and actions fit the policy.

    Raises:
        OwnCodeError: The policy is a user's own and raises, or an action that it returns is not in the space;
            names its file and line.
    """

    def __init__(self, policy: str, env: VectorHiWayEnv) -> None:
        self._env = env
        self._doing = f"the scripted policy {policy!r}"
        self._guard = guarded if is_own_name(policy) else _unguarded
        self._drivers: list[list[ScriptedPolicy]] = [
            [SCRIPTED_POLICIES[policy]() for _ in env.agents] for _ in range(env.num_envs)
        ]

    def begin(self, begun: NDArray[np.bool_]) -> tuple[EpisodeStart, ...]:
        """Begin the episodes of some simulations, shape (B,); return what all play."""
        starts = self._env.episodes
        for row in np.flatnonzero(begun).tolist():
            for agent, driver in enumerate(self._drivers[row]):
                self._guard(driver.begin, self._doing)(starts[row], agent)
        return starts

    def act(self, now: VectorStep, acts: NDArray[np.bool_]) -> list[NDArray]:
        """Return the actions of some active agents, (B, N), for each block of agents, shape (B, n, ...)."""
        actions, first = [], 0
        for block, leaves, mask in zip(self._env.spaces.blocks, now.observations, now.masks, strict=True):
            shape = (len(acts), len(block.agents), *(block.action.shape or ()))
            chosen = np.zeros(shape, block.action.dtype)
            for row, place in np.argwhere(acts[:, first : first + len(block.agents)]).tolist():
                seen = {name: leaf[row, place] for name, leaf in leaves.items()}
                action_mask = np.ones(len(LaneAction), np.bool_) if mask is None else mask[row, place]
                driver: Any = self._drivers[row][first + place]
                given = self._guard(driver.act, self._doing)(_observation(driver, seen), action_mask)
                chosen[row, place] = _checked(given, block.action, driver, self._doing)
            actions.append(chosen)
            first += len(block.agents)
        return actions


def _unguarded(function: Callable[..., Any], doing: str) -> Callable[..., Any]:
    """Return the function of a policy of this package."""
    return function


def _checked(given: Any, space: Space, driver: ScriptedPolicy, doing: str) -> Any:
    """Return what a policy has returned if it is an action of a space, else raise `OwnCodeError`."""
    action, is_whole = np.asarray(given), np.dtype(space.dtype).kind in "iu"
    fits = action.dtype.kind in ("iu" if is_whole else "iuf") and action.shape == space.shape
    fits = fits and bool(np.isfinite(action).all())
    if not fits or (isinstance(space, Discrete) and not space.contains(int(action))):
        kind = "whole" if is_whole else "finite"
        remedy = f"return {kind} numbers of the action space {space}"
        raise OwnCodeError(f"{doing} returns {shown(given)}", place=definition_of(driver.act), remedy=remedy)
    return given


def _observation(driver: ScriptedPolicy, seen: Mapping[str, NDArray]) -> Any:
    """Return a policy's observation: the only array, or a dict of arrays.

    The policies of this package read the vector of observation "benchmark" and ignore other arrays.
    """
    if [*seen] == [""]:
        return seen[""]
    is_ours = type(driver).__module__.startswith("benchmark.scripted.")
    return seen["observation"] if is_ours and "observation" in seen else dict(seen)
