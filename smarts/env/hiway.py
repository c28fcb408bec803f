"""The Gymnasium environment of the paper: dicts of agents, observation objects, specs with adapters."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import gymnasium as gym
import numpy as np

from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.spec import AgentSpec
from smarts.env.adapters import Adapter, ArrayAdapter, adapter_class
from smarts.env.agent_notes import RewardNotes
from smarts.env.dict_env import DictEnv, DictEnvApi
from smarts.env.groups import context_of
from smarts.env.observation_collector import ObservationCollector
from smarts.env.rendering import RENDER_MODES, RenderMode, check_render_mode
from smarts.env.runner import SimulationRunner
from smarts.env.settings import ALL, EnvSettings, SimulationOptions, make_settings
from smarts.observations.context import AdapterContext
from smarts.observations.lists import Observed
from smarts.rewards.own import Reward
from smarts.rewards.weights import Rewards, given_weights
from smarts.types.actions import ActionSpaceType

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
        check_render_mode(render_mode)
        agents = agent_interfaces if agent_specs is None else agent_specs
        if not isinstance(agents, Mapping) or None not in (agent_specs, agent_interfaces):
            raise InterfaceError(
                f"the agents are {agents!r}, of agent_specs or agent_interfaces",
                place="HiWayEnv",
                remedy="give one of the two: a dict of specs by the agents' names",
            )
        if not headless:
            options.setdefault("envision", True)
        settings = make_settings(
            *("HiWayEnv", scenarios, agents),
            options=options,
            known=SimulationOptions,
            others=("scenarios", "agent_specs", "headless", "decision_interval", "render_mode"),
            decision_interval=decision_interval,
        )
        self._env = ObjectDictEnv(settings, render_mode)
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


class ObjectDictEnv(DictEnv):
    """One simulation whose agents observe `Observation` objects.

    Args:
        settings: Settings with one simulation; observation, reward and adapter are not used.
        render_mode: See `Renderer`.
    """

    def __init__(self, settings: EnvSettings, render_mode: RenderMode | None = None) -> None:
        interfaces = settings.interfaces()
        assembly = settings.assemble(interfaces)
        agent_ids = np.arange(len(interfaces), dtype=np.int32)
        context = AdapterContext(
            assembly.scene,
            tuple(interfaces),
            agent_ids,
            ActionSpaceType.Empty,
            settings.decision_interval,
            max_steps=0,
        )
        self._collector, self._metres = ObservationCollector(context), Rewards(context, _REWARD)
        listeners = [self._metres, self._collector]
        runner = SimulationRunner(assembly, listeners, period=settings.decision_interval)
        super().__init__(
            *(runner, interfaces, interfaces, settings.specs(), settings.seed), render_mode=render_mode
        )
        if runner.is_recorded:
            # The terms of a reward that a spec's adapter makes are its own business.
            has_terms = ["reward" not in self.specs[name].own_adapters for name in interfaces]
            columns = slice(0, len(interfaces))
            runner.note(RewardNotes(context, runner, columns, has_terms, given_weights(_REWARD)))

    def _observation(self, name: str) -> Any:
        return self.specs[name].observation_adapter(self._collector.seen[self.columns[name]])

    def _first_infos(self, agents: Collection[str]) -> dict[str, dict[str, Any]]:
        return {name: self._with_observation(name, {}) for name in agents}

    def _reward_and_info(self, name: str, acted: bool, info: dict[str, Any]) -> tuple[Any, Any]:
        column, spec = self.columns[name], self.specs[name]
        seen = self._collector.seen[column]
        metres = float(self._metres.values[0, column]) if acted else 0.0
        info["score"] = float(self.runner.world.agents.distance_travelled[0, column])
        info = self._with_observation(name, info)
        return spec.reward_adapter(seen, metres), spec.info_adapter(seen, metres, info)

    def _with_observation(self, name: str, info: dict[str, Any]) -> dict[str, Any]:
        """Return an info with the agent's observation, and with what did not fit into it."""
        seen = self._collector.seen[self.columns[name]]
        left_out = {"left_out": seen.left_out} if seen.left_out else {}
        return info | {"env_obs": seen} | left_out
