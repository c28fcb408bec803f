"""A fixed list of agents, for learners whose batches have a row for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete, Space
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from smarts.agents.options import InterfaceError
from smarts.env.parallel import ParallelHiWayEnv
from smarts.env.runner import NotCopied
from smarts.observations.action_mask import MASK


class BlackDeath(NotCopied, ParallelEnv):
    """A PettingZoo environment whose agents are all in all results until the last one has ended.

    The results of the decision with which an agent ends are its last of its own. After it, as before it has
    entered, it observes zeros, gets the reward 0, and has one allowed action, 0, which does nothing; once
    ended it stays terminated or truncated. An agent that ends before its first decision is truncated with
    the last one. Infos hold the mask of allowed actions, and the outcome of agents
    that have just ended. Black death is SuperSuit's name of this. Against PettingZoo's rule, `agents` holds
    those that have ended, too, until all have.

    Args:
        env: Environment of agents with discrete actions that observe vectors.

    Raises:
        InterfaceError: An agent acts or observes otherwise.
    """

    def __init__(self, env: ParallelHiWayEnv) -> None:
        self._env = env
        self.metadata, self.render_mode = env.metadata, env.render_mode
        self.possible_agents, self.agents = env.possible_agents, []
        self.observation_spaces, self.action_spaces = env.observation_spaces, env.action_spaces
        self._nothing: dict[str, NDArray] = {}
        self._no_choice: dict[str, NDArray] = {}
        for name in self.possible_agents:
            observation, action = self.observation_space(name), self.action_space(name)
            if not isinstance(action, Discrete) or len(observation.shape or ()) != 1:
                raise InterfaceError(
                    f"agent {name!r} acts in {action} and observes {observation}",
                    place=type(self).__name__,
                    remedy='take the action "Lane" and an observation that is a vector',
                )
            self._nothing[name] = np.zeros(observation.shape or (), observation.dtype)
            self._no_choice[name] = np.eye(1, int(action.n), dtype=np.int8)[0]
        self._terminated: dict[str, bool] = {}
        self._truncated: dict[str, bool] = {}

    @property
    def present(self) -> list[str]:
        """The agents that are in the simulation."""
        return self._env.agents

    def observation_space(self, agent: str) -> Space:
        """Return the space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        """Return the space of an agent's actions."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin the next episode, or with a seed the first one of that seed."""
        observations, infos = self._env.reset(seed)
        self.agents = list(self.possible_agents)
        self._terminated = dict.fromkeys(self.agents, False)
        self._truncated = dict.fromkeys(self.agents, False)
        return self._padded(observations), self._infos(infos)

    def step(self, actions: Mapping[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Step until the next decision; actions of agents that are not in the simulation do nothing.

        Raises:
            ActionError: An action is not among the agent's.
        """
        acting = {name: actions[name] for name in self.present if name in actions}
        observations, rewards, terminated, truncated, infos = self._env.step(acting)
        self._terminated |= terminated
        self._truncated |= truncated
        if not self.present:
            self.agents = []
            for name in self.possible_agents:  # an agent that ended before its first decision is in no result
                self._truncated[name] |= not self._terminated[name]
        return (
            self._padded(observations),
            dict.fromkeys(self.possible_agents, 0.0) | rewards,
            dict(self._terminated),
            dict(self._truncated),
            self._infos(infos),
        )

    def _padded(self, observations: Mapping[str, Any]) -> dict[str, Any]:
        return {
            name: observations[name] if name in observations else nothing.copy()
            for name, nothing in self._nothing.items()
        }

    def _infos(self, infos: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
        masks = {name: infos[name][MASK] for name in self.present if MASK in infos[name]}
        ended = {name: info["outcome"] for name, info in infos.items() if "outcome" in info}
        return {
            name: {MASK: mask} | ({"outcome": ended[name]} if name in ended else {})
            for name, mask in (self._no_choice | masks).items()
        }

    def render(self) -> Any:
        """Return a picture, or show it; see `Renderer.render`."""
        return self._env.render()

    def close(self) -> None:
        """Free the simulation; may be called again."""
        self._env.close()
