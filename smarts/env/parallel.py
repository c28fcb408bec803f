"""The PettingZoo environment: all agents act at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from gymnasium.spaces import Space
from pettingzoo import ParallelEnv

from smarts.env.dict_env import DictEnv, DictEnvApi
from smarts.env.rendering import RENDER_MODES, RenderMode
from smarts.env.settings import Agents, EnvOptions, EnvSettings


class ParallelHiWayEnv(DictEnvApi, ParallelEnv):
    """A simulation as PettingZoo's `ParallelEnv`; see `hiway_parallel_env`."""

    metadata = {  # noqa: RUF012
        "name": "hiway_v0",
        "render_modes": [*RENDER_MODES],
        "is_parallelizable": True,
    }

    def __init__(self, settings: EnvSettings, render_mode: RenderMode | None = None) -> None:
        self._env = DictEnv(settings, render_mode=render_mode)
        self.possible_agents = list(self._env.columns)
        self.agents: list[str] = []
        self.observation_spaces = self._env.observation_spaces()
        self.action_spaces = self._env.action_spaces()
        self.render_mode = render_mode
        self.metadata = {**self.metadata, **self._env.renderer.metadata}

    def observation_space(self, agent: str) -> Space:
        """Return the space of an agent's observations; the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        """Return the space of an agent's actions; the same object each time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin the next episode, or with a seed the first one of that seed."""
        result = self._env.reset(seed)
        self.agents = self._env.agents
        return result

    def step(self, actions: Mapping[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Step until the next decision; agents that end with it are in the results, not in `agents`.

        See `DictEnv.step` for actions and errors.
        """
        result = self._env.step(actions)
        self.agents = self._env.agents
        return result.observations, result.rewards, result.terminated, result.truncated, result.infos


def hiway_parallel_env(
    scenarios: Sequence[str | Path],
    agents: Agents = 4,
    *,
    render_mode: RenderMode | None = None,
    **options: Unpack[EnvOptions],
) -> ParallelHiWayEnv:
    """Return a simulation as a PettingZoo parallel environment.

    Each info has the agent's "action_mask" if it chooses among lane actions.

    Args:
        scenarios: Folders, or names of the suite; they are played in a seeded order.
        agents: How many agents of the benchmark, or specs or interfaces by name. A spec's adapters are
            applied to the observations, rewards and actions.
        render_mode: `"rgb_array"`: `render` returns pictures; `"human"`: each step is shown in a window or a
            notebook.
        options: See `EnvSettings`.

    Raises:
        SmartsError: A scenario, an agent or the render mode is invalid.
    """
    return ParallelHiWayEnv(EnvSettings(scenarios, agents, 1, **options), render_mode)
