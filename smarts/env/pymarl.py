"""The environment of EPyMARL and others made of PyMARL: lists by agent, a state, available actions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np
from gymnasium.spaces import flatdim
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.env.black_death import BlackDeath
from smarts.env.parallel import ParallelHiWayEnv
from smarts.env.runner import NotCopied
from smarts.env.settings import Agents, EnvOptions, EnvSettings
from smarts.observations.action_mask import MASK

_SHARES = {"completed": "goal", "collided": "collision"}
"""The outcomes that `step` counts, by the name under which learners log them."""


class PyMARLEnv(NotCopied):
    """A simulation as EPyMARL's `MultiAgentEnv` (by its methods; EPyMARL itself is not needed).

    The agents are a fixed list, as `BlackDeath` keeps it. The state holds all observations and, for each
    agent, whether it is in the simulation.

    Args:
        scenarios: Folders, or names of the suite; they are played in a seeded order.
        agents: How many agents of the benchmark, or specs or interfaces by name. Their actions are discrete,
            and they observe vectors.
        key: Name of the task in EPyMARL's results; the environment does not use it.
        common_reward: Whether `step` returns one reward for the team, or a list by agent.
        reward_scalarisation: How the team's reward is made of the agents': "sum" or "mean".
        options: See `EnvSettings`.

    Raises:
        SmartsError: A scenario or an agent is invalid.
        InterfaceError: The agents act or observe otherwise, or have no time limit.
    """

    def __init__(
        self,
        scenarios: Sequence[str | Path],
        agents: Agents = 4,
        *,
        key: str = "",
        common_reward: bool = True,
        reward_scalarisation: Literal["sum", "mean"] = "sum",
        **options: Unpack[EnvOptions],
    ) -> None:
        settings = EnvSettings(scenarios, agents, 1, **options)
        self.episode_limit = _most_decisions(settings.interfaces(), settings.decision_interval)
        """Most decisions of an episode."""
        self._env = BlackDeath(ParallelHiWayEnv(settings))
        self.agents = self._env.possible_agents
        """The agents' names, in the order of all lists."""
        self.n_agents = len(self.agents)
        widths = [flatdim(self._env.observation_space(name)) for name in self.agents]
        choices = [flatdim(self._env.action_space(name)) for name in self.agents]
        self._observations = np.zeros((self.n_agents, max(widths)), np.float32)
        self._available = np.zeros((self.n_agents, max(choices)), np.int64)
        self._common_reward = common_reward
        self._share = {"sum": 1.0, "mean": self.n_agents}[reward_scalarisation]
        self._next_seed: int | None = None
        self._decisions = 0
        self._outcomes: list[str] = []

    def reset(
        self, seed: int | None = None, options: dict | None = None
    ) -> tuple[list[NDArray[np.float32]], dict[str, Any]]:
        """Begin the next episode, or with a seed the first one of that seed; return observations and {}."""
        observations, infos = self._env.reset(self._next_seed if seed is None else seed)
        self._next_seed, self._decisions, self._outcomes = None, 0, []
        self._keep(observations, infos)
        return self.get_obs(), {}

    def step(
        self, actions: Sequence[int]
    ) -> tuple[list[NDArray[np.float32]], float | list[float], bool, bool, dict[str, Any]]:
        """Step until the next decision.

        Args:
            actions: Actions by agent; actions of agents that are not in the simulation do nothing.

        Returns:
            Observations; reward; whether all agents have ended; whether the time limit has ended the episode;
            and infos: the shares of the agents that have "completed" their missions and that have "collided"
            so far (EPyMARL logs the infos of the last step), and "episode_limit": True if the time limit has
            ended the episode.
        """
        was_there = self._env.present
        chosen = dict(zip(self.agents, (int(action) for action in actions), strict=True))
        observations, by_agent, _, truncated, infos = self._env.step(chosen)
        self._decisions += 1
        self._keep(observations, infos)
        over = not self._env.present
        # Missions that begin late may last longer than the longest episode of learners.
        limit = any(truncated[name] for name in was_there) if over else self._decisions >= self.episode_limit
        self._outcomes += [info["outcome"] for info in infos.values() if "outcome" in info]
        shares = {name: self._outcomes.count(outcome) / self.n_agents for name, outcome in _SHARES.items()}
        rewards = [float(by_agent[name]) for name in self.agents]
        extra = {"episode_limit": True} if limit else {}
        reward = sum(rewards) / self._share if self._common_reward else rewards
        return self.get_obs(), reward, over and not limit, limit, shares | extra

    def _keep(self, observations: Mapping[str, Any], infos: Mapping[str, Any]) -> None:
        """Keep what the agents observe and may do; shorter vectors and masks end in zeros."""
        for agent_id, name in enumerate(self.agents):
            seen, mask = observations[name], infos[name][MASK]
            self._observations[agent_id, : len(seen)] = seen
            self._available[agent_id, : len(mask)] = mask

    def get_obs(self) -> list[NDArray[np.float32]]:
        """Return what the agents observe, arrays of `get_obs_size()` numbers."""
        return list(self._observations.copy())

    def get_obs_agent(self, agent_id: int) -> NDArray[np.float32]:
        """Return what an agent observes."""
        return self._observations[agent_id].copy()

    def get_obs_size(self) -> int:
        """Return the length of an observation."""
        return self._observations.shape[1]

    def get_state(self) -> NDArray[np.float32]:
        """Return all observations, and 1 for each agent that is in the simulation, (get_state_size(),)."""
        present = self._env.present
        flags = np.array([name in present for name in self.agents], np.float32)
        return np.concatenate([self._observations.ravel(), flags])

    def get_state_size(self) -> int:
        """Return the length of the state."""
        return self.n_agents * (self.get_obs_size() + 1)

    def get_avail_actions(self) -> list[list[int]]:
        """Return for each agent and action 1 if it is available, else 0."""
        return self._available.tolist()

    def get_avail_agent_actions(self, agent_id: int) -> list[int]:
        """Return for each action of an agent 1 if it is available, else 0."""
        return self._available[agent_id].tolist()

    def get_total_actions(self) -> int:
        """Return how many actions the agents have."""
        return self._available.shape[1]

    def get_env_info(self) -> dict[str, int]:
        """Return the sizes that learners are made from."""
        return {
            "state_shape": self.get_state_size(),
            "obs_shape": self.get_obs_size(),
            "n_actions": self.get_total_actions(),
            "n_agents": self.n_agents,
            "episode_limit": self.episode_limit,
        }

    def get_stats(self) -> dict[str, float]:
        """Return {}: the infos of `step` hold what is worth logging."""
        return {}

    def seed(self, seed: int | None = None) -> None:
        """Let the next `reset` begin with the first episode of a seed."""
        self._next_seed = seed

    def save_replay(self) -> None:
        """Do nothing: `simulation=Options(record=FOLDER)` records episodes."""

    def render(self) -> None:
        """Do nothing: `smarts-bench render` draws recorded episodes."""

    def close(self) -> None:
        """Free the simulation; may be called again."""
        self._env.close()


def _most_decisions(interfaces: Mapping[str, AgentInterface], period: int) -> int:
    """Return how many decisions the longest episode has."""
    limits = {name: interface.max_episode_steps for name, interface in interfaces.items()}
    if endless := [name for name, limit in limits.items() if limit is None]:
        raise InterfaceError(
            f"agent {endless[0]!r} has no time limit, and learners of whole episodes need one",
            place="PyMARLEnv",
            remedy="give AgentInterface(max_episode_steps=...)",
        )
    return -(-max(limit or 0 for limit in limits.values()) // period)
