"""The Gymnasium environment of a single agent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

import gymnasium as gym

from smarts.agents.interface import AgentInterface
from smarts.agents.spec import AgentSpec
from smarts.env.dict_env import DictEnv, DictEnvApi
from smarts.env.rendering import RENDER_MODES, RenderMode
from smarts.env.settings import EnvOptions, EnvSettings, check_keywords
from smarts.errors import ActionError, ScenarioError
from smarts.types.events import Outcome

AGENT = "agent-0"
"""The name of the agent."""


class SingleHiWayEnv(DictEnvApi, gym.Env):
    """A simulation with one learning agent, "agent-0".

    Args:
        scenarios: Folders, or names of the suite; scenarios and their missions are played in an order drawn
            from the seed.
        agent: Its spec or interface; by default, that of the benchmark. A spec's adapters are applied to the
            observation, the reward and the action.
        render_mode: `"rgb_array"`: `render` returns pictures; `"human"`: each step is shown in a window or a
            notebook.
        options: See `EnvSettings`; the mask of the lane actions is in each info.

    Raises:
        SmartsError: A scenario or the agent is invalid.
    """

    metadata = {"render_modes": [*RENDER_MODES]}  # noqa: RUF012

    def __init__(
        self,
        scenarios: Sequence[str | Path],
        agent: AgentSpec | AgentInterface | None = None,
        *,
        render_mode: RenderMode | None = None,
        **options: Unpack[EnvOptions],
    ) -> None:
        check_keywords(SingleHiWayEnv, options)
        settings = EnvSettings(scenarios, 1 if agent is None else {AGENT: agent}, 1, **options)
        self._env = DictEnv(settings, render_mode=render_mode)
        self.observation_space = self._env.observation_spaces()[AGENT]
        self.action_space = self._env.action_spaces()[AGENT]
        self.metadata, self.render_mode = self._env.renderer.metadata, render_mode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode, or with a seed the first one of that seed; return observation and info.

        Raises:
            TrafficError: The traffic engine failed; another reset tries the episode after this one.
            ScenarioError: The agent has ended before its first decision.
        """
        observations, infos = self._env.reset(seed)
        super().reset(seed=seed, options=options)
        if AGENT not in observations:
            world = self._env.runner.world
            outcome = Outcome(int(world.agents.outcome[0, 0])).name.lower()
            raise ScenarioError(
                f"{AGENT!r} has ended before its first decision: {outcome}",
                place=f"episode {world.episode[0]}",
                remedy="move the mission's start or make episodes longer; reset() tries the next episode",
            )
        return observations[AGENT], infos[AGENT]

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step until the next decision; return observation, reward, terminated, truncated and info.

        Raises:
            ActionError: The action is not in the space, or the episode is over.
            TrafficError: The traffic engine failed; the next reset works.
            SmartsError: The environment was closed, or never reset.
        """
        result = self._env.step({AGENT: action})
        if AGENT not in result.observations:
            raise ActionError("the episode is over", place="SingleHiWayEnv.step", remedy="call reset()")
        return (
            result.observations[AGENT],
            result.rewards[AGENT],
            result.terminated[AGENT],
            result.truncated[AGENT],
            result.infos[AGENT],
        )

    def annotate(self, name: str, values: Any) -> None:
        """Add the agent's value to the record of its next decision; see `DictEnv.annotate`."""
        self._env.annotate(name, {AGENT: values})
