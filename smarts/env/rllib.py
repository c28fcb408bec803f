"""The RLlib face."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from ray.rllib.env.multi_agent_env import MultiAgentEnv
from ray.rllib.utils.typing import AgentID

from smarts.env.arrays import EnvSettings
from smarts.env.not_copied import NotCopied
from smarts.env.setting_checks import check_instance
from smarts.env.solo import SoloStep, SoloWorld
from smarts.errors import SmartsError, nearest_names
from smarts.types.streams import check_seed

_OLD_NAMES = {"agent_specs": "agents"}
_WITHOUT_EFFECT = ("headless", "sim_name", "num_envs")
# The last is what `algorithms` tells every environment, for those that are several at once.


def setting_of(config: Mapping[str, Any]) -> EnvSettings:
    """Return the setting that an `env_config` describes.

    Raises:
        SmartsError: It has an unknown key; the remedy names the nearest.
    """
    check_instance("env_config", config, Mapping, "a dict, such as {'scenarios': ['loop'], 'agents': 4}")
    known = [field.name for field in fields(EnvSettings) if field.name != "worlds"]
    given = {_OLD_NAMES.get(key, key): value for key, value in config.items() if key not in _WITHOUT_EFFECT}
    for key in given:
        if key not in known:
            raise SmartsError(
                f"there is no setting {key!r}",
                place="env_config",
                remedy=nearest_names(key, [*known, *_OLD_NAMES, *_WITHOUT_EFFECT]),
            )
    if {"agents", "agent_specs"} <= config.keys():
        raise SmartsError("agents and agent_specs are both there", place="env_config", remedy="give one")
    if "scenarios" not in given:
        raise SmartsError("there are no scenarios", place="env_config", remedy="give {'scenarios': ['loop']}")
    return EnvSettings(**given)


class RLlibHiWayEnv(NotCopied, MultiAgentEnv):
    """A simulation as RLlib's `MultiAgentEnv`.

    Observations of the benchmark's agents are vectors, which RLlib's own networks take. The mask of their
    lane actions is in the infos; with `action_mask=True` it is in the observations too, which are then dicts.

    Args:
        config: `scenarios`, `agent_specs` (specs or interfaces by name, or how many agents of the benchmark),
            `seed`, `action_mask`, and whatever else `smarts.env.arrays.Setting` has. `headless` is without
            effect.

    Raises:
        SmartsError: The configuration is not what it has to be.
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        self._world = SoloWorld(setting_of(config))
        self.possible_agents: list[AgentID] = [*self._world.possible_agents]
        self.agents: list[AgentID] = []
        self.observation_spaces = {**self._world.observation_spaces}
        self.action_spaces = {**self._world.action_spaces}

    def reset(
        self, *, seed: int | None = None, options: dict | None = None
    ) -> tuple[dict[AgentID, Any], dict[AgentID, Any]]:
        """Begin the next episode, or with a seed the first one of that seed."""
        if seed is not None:
            check_seed(seed, "reset")
        super().reset(seed=seed, options=options)
        observations, infos = self._world.reset(seed)
        self.agents = list(observations)
        return {**observations}, {**infos}

    def step(self, action_dict: Mapping[Any, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Carry out a decision.

        Agents that end with it are among `agents` until the next step, as RLlib wants those whose
        observations it is given to be.

        When the episode ends and some of its last agents are only cut short, that is said by
        `truncated["__all__"]` alone; else by `terminated["__all__"]`. Each info has the outcome.

        Raises:
            ActionError: An agent is unknown, or an action is not in its space.
            TrafficError: The traffic engine failed; the next reset works.
        """
        told = self._world.step(action_dict)
        self.agents = list(told.observations)
        return told.observations, told.rewards, *_dones(told), told.infos

    def annotate(self, name: str, values: Mapping[str, Any]) -> None:
        """Add to the record what agents have to say about their next actions; see `SoloWorld.annotate`."""
        self._world.annotate(name, values)

    def close(self) -> None:
        """Give back what the simulation holds; may be called again."""
        self._world.close()


def _dones(told: SoloStep) -> tuple[dict[AgentID, bool], dict[AgentID, bool]]:
    """Return what is terminated and truncated, so that RLlib values what those see who are cut short.

    `MultiAgentEpisode.add_env_step` (RLlib 2.60) takes all agents for terminated if "__all__" is, or if each
    agent has a flag of its own. So whoever is cut at the episode's end has none but "__all__".
    """
    terminated, truncated = {**told.terminated}, {**told.truncated}
    is_cut = told.finished and any(truncated.values())
    if is_cut:
        truncated = dict.fromkeys(truncated, False)
    return (
        {**terminated, "__all__": told.finished and not is_cut},
        {**truncated, "__all__": is_cut},
    )
