"""RLlib's callbacks per episode, called by the joint runner for its training environments."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.callbacks.utils import make_callback
from ray.rllib.utils import force_list

from algorithms.joint.env import Bools, Ints, JointStep

START, STEP, END = "on_episode_start", "on_episode_step", "on_episode_end"


@dataclass
class LiveEpisode:
    """The `episode` of callbacks; RLlib's own episodes would cost more than the whole step.

    Attributes:
        id_: Unique within a runner.
        env_index: The environment that plays it.
        rewards: Rewards of the agents that acted in the last step, by agent.
        returns: Sum of rewards so far, by agent.
        length: Steps so far.
        acted: Actions so far, over all agents.
        is_done: Whether the last step ended it.
        metrics: Numbers that the environment reports at the end.
        custom_data: Anything that a callback wants to keep until the episode ends.
    """

    id_: str
    env_index: int
    rewards: dict[str, float]
    returns: dict[str, float]
    length: int = 0
    acted: int = 0
    is_done: bool = False
    metrics: dict[str, float] = field(default_factory=dict)
    custom_data: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.length

    def env_steps(self) -> int:
        """Return the steps so far."""
        return self.length

    def agent_steps(self) -> int:
        """Return the actions so far, over all agents."""
        return self.acted

    def get_return(self) -> float:
        """Return the sum of all agents' rewards so far."""
        return sum(self.returns.values())


class EpisodeCallbacks:
    """Calls `on_episode_start`, `on_episode_step` and `on_episode_end` of the config's callbacks.

    Each gets `episode` (LiveEpisode), `env_runner`, `metrics_logger`, `env` (all environments), `env_index`
    and `rl_module`. An episode whose environment fails ends without `on_episode_end`. Evaluation calls
    nothing.
    """

    def __init__(self, runner: Any) -> None:
        self._runner = runner
        self._objects: list[RLlibCallback] = [
            create() for create in force_list(runner.config.callbacks_class)
        ]
        self._called = {hook for hook in (START, STEP, END) if self._wants(hook)}
        self._episodes: dict[int, LiveEpisode] = {}
        self._started = 0

    def __bool__(self) -> bool:
        """Return whether any callback is overridden."""
        return bool(self._called)

    def started(self, rows: Ints) -> None:
        """Begin the episodes of these environments."""
        for b in rows.tolist():
            zeros = dict.fromkeys(self._runner.spec.agents, 0.0)
            episode_id = f"{self._runner.worker_index}_{self._started}"
            self._episodes[b] = LiveEpisode(episode_id, b, {}, zeros)
            self._started += 1
            self._call(START, b)

    def stepped(self, step: JointStep, acted: Bools) -> None:
        """Account for a step of all environments.

        Args:
            step: What happened.
            acted: Agents that acted in it, (B, N).
        """
        agents = self._runner.spec.agents
        for b in range(len(acted)):
            if b in step.failed:
                continue
            episode = self._episodes[b]
            episode.rewards = {agents[i]: float(step.rewards[b, i]) for i in np.flatnonzero(acted[b])}
            for agent, reward in episode.rewards.items():
                episode.returns[agent] += reward
            episode.length += 1
            episode.acted += len(episode.rewards)
            episode.is_done = bool(step.reset[b])
            self._call(STEP, b)
            if episode.is_done:
                episode.metrics = dict(step.metrics.get(b, {}))
                self._call(END, b)
        self.started(np.array(sorted({*np.flatnonzero(step.reset).tolist(), *step.failed}), int))

    def _wants(self, hook: str) -> bool:
        overridden = any(getattr(type(o), hook) is not getattr(RLlibCallback, hook) for o in self._objects)
        return overridden or bool(getattr(self._runner.config, f"callbacks_{hook}"))

    def _call(self, hook: str, b: int) -> None:
        if hook not in self._called:
            return
        make_callback(
            hook,
            callbacks_objects=self._objects,
            callbacks_functions=getattr(self._runner.config, f"callbacks_{hook}"),
            kwargs={
                "episode": self._episodes[b],
                "env_runner": self._runner,
                "metrics_logger": self._runner.metrics,
                "env": self._runner.env,
                "env_index": b,
                "rl_module": self._runner.module,
            },
        )
