"""The RLlib environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ray.rllib.env.multi_agent_env import MultiAgentEnv
from ray.rllib.utils.typing import AgentID

from smarts.env.dict_env import DictEnv, DictEnvApi, StepResult
from smarts.env.settings import ALL, EnvSettings


class RLlibHiWayEnv(DictEnvApi, MultiAgentEnv):
    """A simulation as RLlib's `MultiAgentEnv`.

    Observations of the benchmark's agents are vectors, which RLlib's own networks take. The mask of their
    lane actions is in the infos; with `action_mask=True` it is in the observations too, which are then dicts.

    Each environment runner plays other episodes, those of the world of its `worker_index`. Several
    environments of a runner do so if the algorithm has a seed (`config.debugging(seed=...)`), which RLlib
    hands to `reset`.

    Args:
        config: `scenarios`, `agent_specs` (specs or interfaces by name, or how many agents of the benchmark),
            `seed`, `action_mask`, and the other fields of `EnvSettings`. `headless` False is
            `envision` True.

    Raises:
        SmartsError: The configuration is invalid.
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        # `algorithms` gives `num_envs` to every environment; others hold several simulations.
        not_ours = ("agent_specs", "headless", "sim_name", "num_envs")
        given = {key: value for key, value in config.items() if key not in not_ours}
        if "agent_specs" in config:
            given["agents"] = config["agent_specs"]
        if not config.get("headless", True):
            given.setdefault("envision", True)
        self._env = DictEnv(EnvSettings(**given), world=getattr(config, "worker_index", 0))
        self.possible_agents: list[AgentID] = [*self._env.columns]
        self.agents: list[AgentID] = []
        self.observation_spaces = {**self._env.observation_spaces()}
        self.action_spaces = {**self._env.action_spaces()}

    def reset(
        self, *, seed: int | None = None, options: dict | None = None
    ) -> tuple[dict[AgentID, Any], dict[AgentID, Any]]:
        """Begin the next episode, or with a seed the first one of that seed."""
        observations, infos = self._env.reset(seed)
        super().reset(seed=seed, options=options)
        self.agents = list(observations)
        return {**observations}, {**infos}

    def step(self, action_dict: Mapping[Any, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Step until the next decision.

        Agents that end with it stay in `agents` until the next step, since RLlib expects every agent with an
        observation there.

        When the episode ends and some of its last agents are only cut short, `truncated["__all__"]` alone is
        true; else `terminated["__all__"]`. Each info has the outcome. See `DictEnv.step` for actions and
        errors.
        """
        result = self._env.step(action_dict)
        self.agents = list(result.observations)
        for name in result.entered:
            # RLlib takes no reward before an agent's first action.
            for part in (result.rewards, result.terminated, result.truncated):
                del part[name]
        return result.observations, result.rewards, *_dones(result), result.infos


def _dones(result: StepResult) -> tuple[dict[AgentID, bool], dict[AgentID, bool]]:
    """Return the done flags, so that RLlib bootstraps the last values of agents that are cut short.

    `MultiAgentEpisode.add_env_step` (RLlib 2.60) takes all agents for terminated if "__all__" is, or if each
    agent has a flag of its own. So agents that are cut short at the episode's end have no flag but "__all__".
    """
    terminated, truncated = {**result.terminated}, {**result.truncated}
    is_cut = result.finished and any(truncated.values())
    if is_cut:
        truncated = dict.fromkeys(truncated, False)
    return {**terminated, ALL: result.finished and not is_cut}, {**truncated, ALL: is_cut}
