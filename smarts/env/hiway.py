"""The Gymnasium environment of the paper: dicts of agents, observation objects, specs with adapters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import gymnasium as gym

from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.spec import AgentSpec
from smarts.env.adapters import Adapter, ArrayAdapter, adapter_class
from smarts.env.dict_env import DictEnv, DictEnvApi
from smarts.env.groups import context_of
from smarts.env.rendering import RENDER_MODES, RenderMode
from smarts.env.settings import ALL, EnvSettings, SimulationOptions, check_keywords
from smarts.observations.lists import Observed
from smarts.rewards.own import Reward

_REWARD = "route_metres"


class HiWayEnv(DictEnvApi, gym.Env):
    """A simulation whose agents are driven by their specs: `gymnasium.make("smarts.env:hiway-v0", ...)`.

    Observations are `Observation` objects with the original's field names, rewards the metres driven along
    the route; both pass through the adapters of the agent's spec. An agent that enters later appears in the
    observations then; an agent that ends appears in them, and in the done dicts, one last time. An agent that
    learns in bubbles ends where its vehicle leaves the bubble, and appears again with another; there are
    steps without any agent.

    Args:
        scenarios: Folders, or names of the suite; they are played in a seeded order.
        agent_specs: The agents' specs, or their interfaces alone, by name.
        agent_interfaces: The same argument under the name that SMARTS 2.0.1 has for it; give one of the two.
        headless: False is `envision=True`.
        decision_interval: Steps of 0.1 s from one decision to the next.
        sim_name: Without effect. Kept so that the original's calls work.
        render_mode: `"rgb_array"`: `render` returns pictures; `"human"`: each step is shown in a window or a
            notebook.
        options: `seed`, `simulation`, `traffic`, `social_agents`, `hosts`, `learn_in_bubbles`, `episode_time`
            and `envision`: see `EnvSettings`.

    Raises:
        SmartsError: A scenario or an agent is invalid.
    """

    metadata = {"render_modes": [*RENDER_MODES]}  # noqa: RUF012

    def __init__(
        self,
        scenarios: Sequence[str | Path],
        agent_specs: Mapping[str, AgentSpec | AgentInterface] | None = None,
        *,
        agent_interfaces: Mapping[str, AgentInterface] | None = None,
        headless: bool = True,
        decision_interval: int = 1,
        sim_name: str | None = None,
        render_mode: RenderMode | None = None,
        **options: Unpack[SimulationOptions],
    ) -> None:
        agents = agent_interfaces if agent_specs is None else agent_specs
        check_keywords(HiWayEnv, options, SimulationOptions)
        if not isinstance(agents, Mapping) or None not in (agent_specs, agent_interfaces):
            raise InterfaceError(
                f"the agents are {agents!r}, of agent_specs or agent_interfaces",
                place="HiWayEnv",
                remedy="give one of the two: a dict of specs by the agents' names",
            )
        if not headless:
            options.setdefault("envision", True)
        own = {"observation": (), "reward": _REWARD, "adapter": None}
        settings = EnvSettings(scenarios, agents, 1, decision_interval=decision_interval, **own, **options)
        self._env = DictEnv(settings, sees_objects=True, render_mode=render_mode)
        self._interfaces = settings.interfaces()
        self.agent_specs = dict(self._env.specs)
        self.agent_ids = list(agents)
        """The names of all agents, active or not."""
        self.decision_interval = decision_interval
        self.metadata, self.render_mode = self._env.renderer.metadata, render_mode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin the next episode, or with a seed the first one of that seed."""
        result = self._env.reset(seed)
        super().reset(seed=seed, options=options)
        return result

    def step(self, action: Mapping[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Step until the next decision; return observations, rewards, terminated, truncated, infos by agent.

        Both done dicts have "__all__" too: whether the episode is over, and whether it is so because some of
        its last agents were only cut short. See `DictEnv.step` for actions and errors.
        """
        result = self._env.step(action)
        over, cut = result.finished, result.finished and any(result.truncated.values())
        terminated, truncated = {**result.terminated, ALL: over}, {**result.truncated, ALL: cut}
        return result.observations, result.rewards, terminated, truncated, result.infos

    def watch(
        self,
        observation: Observed = "benchmark",
        reward: Reward | None = None,
        *,
        discount: float | None = None,
        adapter: Adapter | None = None,
        adapter_options: Mapping[str, Any] | None = None,
    ) -> ArrayAdapter:
        """Make observations and rewards as arrays too, of every step from now on.

        Args:
            observation: See `EnvSettings`, as for the other arguments.
            reward: See `EnvSettings`.
            discount: See `EnvSettings`.
            adapter: See `EnvSettings`.
            adapter_options: See `EnvSettings`.

        Returns:
            The adapter, with the latest `observations` and `rewards`; its agents are all of the
            environment's, in the order of `agent_ids`.
        """
        runner = self._env.runner
        context = context_of(runner.scene, self._interfaces, 0, runner.period)
        make = adapter_class(adapter, adapter_options)
        made = make(context, observation, reward, discount, **(adapter_options or {}))
        runner.listen(made)
        return made
