"""Tiny games with known scores; each one detects a kind of wrong implementation."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from ray.rllib.env.multi_agent_env import MultiAgentEnv


class Game(MultiAgentEnv):
    """All agents act in every step of an episode of fixed length; the end is a time limit unless `ends`."""

    length = 10
    ends = False

    def __init__(
        self, config: dict[str, Any] | None = None, *, agents: int = 2, actions: int = 2, width: int = 1
    ):
        super().__init__()
        self.possible_agents = self.agents = [f"agent_{i}" for i in range(agents)]
        self.observation_spaces = {a: Box(-1.0, 1.0, (width,), np.float32) for a in self.agents}
        self.action_spaces = {a: Discrete(actions) for a in self.agents}
        self.rng = np.random.default_rng(0)

    def reset(self, *, seed=None, options=None):
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.t = 0
        return self.observe(), {}

    def step(self, action_dict):
        rewards = self.reward([int(action_dict[a]) for a in self.agents])
        self.t += 1
        over = self.t >= self.length
        done, going = {"__all__": over}, {"__all__": False}
        ends, cuts = (done, going) if self.ends else (going, done)
        return self.observe(), dict(zip(self.agents, rewards, strict=True)), ends, cuts, {}

    def observe(self) -> dict[str, np.ndarray]:
        return {a: np.zeros(1, np.float32) for a in self.agents}

    def reward(self, actions: list[int]) -> list[float]:
        raise NotImplementedError


class Constant(Game):
    """G1: reward 1 each step, cut at 10. At gamma 0.9 values are 10; 5.26 or 4.28 if cuts are ends."""

    def reward(self, actions):
        return [1.0] * len(actions)


class Cues(Game):
    """G2: r_i = 1[a_i = c_i] - 2 * 1[a_j = c_j], 4 cues. Own rewards: hits 1.0; sum, swap: 0."""

    cues = 4

    def __init__(self, config=None):
        super().__init__(agents=2, actions=self.cues, width=self.cues)
        self.hits: list[float] = []

    def observe(self):
        self.cue = self.rng.integers(self.cues, size=len(self.agents))
        return {a: np.eye(self.cues, dtype=np.float32)[c] for a, c in zip(self.agents, self.cue, strict=True)}

    def hit(self, actions):
        return [float(a == c) for a, c in zip(actions, self.cue, strict=True)]

    def reward(self, actions):
        first, second = self.hit(actions)
        return [first - 2 * second, second - 2 * first]


class Product(Cues):
    """G3: r = product of 1[a_i = c_i], 3 cues, for both. Score per step 1.0; misaligned agents 0.33."""

    cues = 3

    def reward(self, actions):
        return [float(np.prod(self.hit(actions)))] * 2


class Target(Game):
    """Continuous: r_i = -(a_i - c_i)^2 with c_i in [-1, 1] observed, actions in [0, 4] centred at 2."""

    def __init__(self, config=None):
        super().__init__(agents=2)
        self.action_spaces = {a: Box(0.0, 4.0, (1,), np.float32) for a in self.agents}

    def observe(self):
        self.cue = self.rng.uniform(-1, 1, len(self.agents)).astype(np.float32)
        return {a: c[None] for a, c in zip(self.agents, self.cue, strict=True)}

    def step(self, action_dict):
        # Unlike `Game.step`, do not convert actions to integers.
        rewards = [
            -float((action_dict[a][0] / 2 - 1 - c) ** 2) for a, c in zip(self.agents, self.cue, strict=True)
        ]
        self.t += 1
        over = {"__all__": self.t >= self.length}
        return self.observe(), dict(zip(self.agents, rewards, strict=True)), {"__all__": False}, over, {}


class TwoStep(MultiAgentEnv):
    """QMIX's two-step game: agent 0 picks the matrix, all 7 or [[0, 1], [1, 8]]. QMIX 8, VDN 7."""

    matrices = (((7, 7), (7, 7)), ((0, 1), (1, 8)))

    def __init__(self, config=None):
        super().__init__()
        self.possible_agents = self.agents = ["a", "b"]
        self.observation_spaces = {a: Box(0.0, 1.0, (3,), np.float32) for a in self.agents}
        self.action_spaces = {a: Discrete(2) for a in self.agents}

    def reset(self, *, seed=None, options=None):
        self.place = 0
        return self._see(), self._infos()

    def step(self, action_dict):
        if self.place == 0:
            self.place = 1 + int(action_dict["a"])
            rewards, over = 0.0, False
        else:
            rewards = self.matrices[self.place - 1][int(action_dict["a"])][int(action_dict["b"])]
            over = True
        # Half per agent, so that the team's sum is the game's reward.
        shared = dict.fromkeys(self.agents, rewards / 2)
        return self._see(), shared, {"__all__": over}, {"__all__": False}, self._infos()

    def _see(self):
        return dict.fromkeys(self.agents, np.eye(3, dtype=np.float32)[self.place])

    def _infos(self):
        return {"__common__": {"state": np.eye(3, dtype=np.float32)[self.place]}}


class Ragged(MultiAgentEnv):
    """Random late arrivals, terminations, truncations, unflagged departures, time limits and crashes.

    Observations are (trajectory id in (0, 1], step of the trajectory, time of the episode), so that all
    observations differ.
    """

    crash = 0.03

    def __init__(self, config=None):
        super().__init__()
        config = config or {}
        self.crash = config.get("crash", self.crash)
        self.possible_agents = self.agents = ["a", "b", "c"]
        self.observation_spaces = {a: Box(-np.inf, np.inf, (3,), np.float32) for a in self.agents}
        self.action_spaces = {a: Discrete(3) for a in self.agents}

    def reset(self, *, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.t = 0
        self.trajectories: dict[str, list[float]] = {}
        self.gone: set[str] = set()
        self._arrive(0.7)
        if not self.trajectories:
            self.trajectories["a"] = self._new_trajectory()
        return self._see(self.trajectories), {}

    def step(self, action_dict):
        if self.rng.random() < self.crash:
            raise RuntimeError("crash")
        if set(action_dict) != set(self.trajectories):
            raise ValueError(f"actions for {set(action_dict)}, alive are {set(self.trajectories)}")
        self.t += 1
        rewards, ends, cuts = {}, {}, {}
        seen = dict(self.trajectories)
        for agent in list(self.trajectories):
            self.trajectories[agent][1] += 1
            rewards[agent] = float(self.rng.standard_normal())
            u = self.rng.random()
            if u < 0.2:
                del self.trajectories[agent]
                if u < 0.08:
                    ends[agent] = True
                elif u < 0.16 or self.t >= 12:  # a time limit requires a last observation
                    cuts[agent] = True
                else:
                    del seen[agent]
                    self.gone.add(agent)
        ended = {a for a in (*ends, *cuts)}
        self._arrive(0.3, ended)
        seen |= self.trajectories
        ends["__all__"], cuts["__all__"] = False, self.t >= 12
        return self._see(seen), rewards, ends, cuts, {}

    def _new_trajectory(self):
        return [float(1 - self.rng.random()), 0.0]

    def _arrive(self, chance, ended=()):
        for agent in self.agents:
            free = agent not in self.trajectories and agent not in self.gone and agent not in ended
            if free and self.rng.random() < chance:
                self.trajectories[agent] = self._new_trajectory()

    def _see(self, trajectories):
        return {a: np.array([*trajectory, self.t], np.float32) for a, trajectory in trajectories.items()}


class Broken(Constant):
    """Raises an error or returns NaN in a given step of every episode (`config`: raise_at, nan_at)."""

    def __init__(self, config=None):
        super().__init__()
        config = config or {}
        self.raise_at, self.nan_at = config.get("raise_at"), config.get("nan_at")
        self.chance = config.get("chance", 1.0)

    def step(self, action_dict):
        result = super().step(action_dict)
        hit = self.rng.random() < self.chance
        if hit and self.t == self.raise_at:
            raise RuntimeError("broken on purpose")
        if hit and self.t == self.nan_at:
            result[0]["agent_0"][:] = np.nan
        return result


class Hanging(Constant):
    """Hangs in the first environment runner once `file` exists."""

    def __init__(self, config):
        super().__init__()
        self.hang = config.worker_index == 1
        self.file = config["file"]

    def step(self, action_dict):
        if self.hang and os.path.exists(self.file):
            os.remove(self.file)
            time.sleep(3600)
        return super().step(action_dict)
