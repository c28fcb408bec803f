"""MAVEN: latents of whole episodes, mutual information, the latents' policy, and committed exploration."""

from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from ray.rllib.env.multi_agent_env import MultiAgentEnv
from rigs import Rig

STEPS = 10


class Committed(MultiAgentEnv):
    """The paper's m-step matrix game, m = 10, whose first and last steps need both agents.

    The first joint action chooses a branch: (0, 0) or (1, 1); others end the episode. Each step that repeats it
    pays 1, others end the episode. The last step of the branch (0, 0) pays 4 for (1, 1), else 1. Best: m + 3.
    The other branch pays m.
    """

    def __init__(self, config=None):
        super().__init__()
        self.possible_agents = self.agents = ["a", "b"]
        self.observation_spaces = {a: Box(0.0, 1.0, (STEPS + 3,), np.float32) for a in self.agents}
        self.action_spaces = {a: Discrete(2) for a in self.agents}

    def reset(self, *, seed=None, options=None) -> Any:
        self.t, self.branch = 0, 2
        return self._see(), {}

    def step(self, action_dict) -> Any:
        first, second = (int(action_dict[a]) for a in self.agents)
        if self.t == 0 and first == second:
            self.branch = first
        reward = float(first == second == self.branch)
        self.t += 1
        if self.t == STEPS and self.branch == 0:
            reward = 4.0 if first == second == 1 else 1.0
        over = self.t == STEPS or not reward
        return self._see(), dict.fromkeys(self.agents, reward / 2), {"__all__": over}, {"__all__": False}, {}

    def _see(self):
        seen = np.zeros(STEPS + 3, np.float32)
        seen[min(self.t, STEPS - 1)] = seen[STEPS + self.branch] = 1
        return dict.fromkeys(self.agents, seen)


COMMITTED = {"lr": 2e-3, "learning_starts": 64, "updates_per_step": 0.25, "batch_size": 64, "capacity": 10_000}
COMMITTED |= {"epsilon": (1.0, 0.01), "epsilon_steps": 200, "tau": 0.02}


def committed_score(seed, name="maven", steps=10_000, episodes=50, **settings):
    """Return the team's mean return of greedy episodes."""
    rig = Rig(name, Committed, seed=seed, **{**COMMITTED, **settings})
    done = 0
    while done < steps:
        rollout = rig.rollout(8, **rig.config.exploration(done)._asdict())
        rig.learner.update_joint(rollout)
        done += rollout.env_steps()
    rig.policies.refresh()
    from algorithms.parts.distributions import Exploration

    played = rig.sampler.episodes(1_000_000 + np.arange(episodes), Exploration(explore=False))
    return float(np.mean([e.returns.sum() for e in played]))
