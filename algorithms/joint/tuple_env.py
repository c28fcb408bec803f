"""Games of Gymnasium whose spaces are tuples, as a `MultiAgentEnv`: level-based foraging, RWARE."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import gymnasium as gym
import numpy as np
from ray.rllib.env.multi_agent_env import MultiAgentEnv


class TupleEnv(MultiAgentEnv):
    """A game that takes and returns a list with an entry for each agent; an episode ends for all at once.

    Args:
        env: The game; its agents become "agent_0", "agent_1", ...
    """

    def __init__(self, env: gym.Env) -> None:
        super().__init__()
        self._env, spaces = env, (env.observation_space, env.action_space)
        self.possible_agents = self.agents = [f"agent_{k}" for k in range(len(spaces[0]))]  # type: ignore[arg-type]
        self.observation_spaces, self.action_spaces = (self._by_agent(each) for each in spaces)  # type: ignore[arg-type]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict, dict]:
        """Start an episode (RLlib)."""
        return self._by_agent(self._env.reset(seed=seed, options=options)[0]), {}

    def step(self, action_dict: dict[Any, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Act for all agents (RLlib)."""
        seen, rewards, ends, cuts, _ = self._env.step([action_dict[agent] for agent in self.agents])
        over, cut = ({"__all__": bool(np.all(each))} for each in (ends, cuts))
        return self._by_agent(seen), self._by_agent(rewards), over, cut, {}  # type: ignore[arg-type]

    def close(self) -> None:
        """Close the game."""
        self._env.close()

    def _by_agent(self, values: Iterable[Any]) -> dict[Any, Any]:
        return dict(zip(self.agents, values, strict=True))
