"""Observations that policies need beside the environment's: the neighbours' mean action one step ago."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box, Discrete

from algorithms.joint.env import (
    Bools,
    Floats,
    Ints,
    JointSpaces,
    JointStep,
    VectorJointEnv,
    columns_of,
    name_of,
)
from algorithms.joint.neighbours import Graph, Neighbourhood
from algorithms.parts.communication import mean_over

MEAN_ACTION = "@mean_action"
"""Observation leaf of `WithMeanActions`."""


def common_actions(spaces: JointSpaces) -> int:
    """Return the number of discrete actions of every agent, or 0 where they differ or are continuous."""
    sizes = {int(b.action.n) if isinstance(b.action, Discrete) else 0 for b in spaces.blocks}
    return sizes.pop() if len(sizes) == 1 else 0


class WithMeanActions:
    """A vector environment whose agents also see the mean action of their neighbours one step ago.

    The leaf `MEAN_ACTION` (A,) is the mean of the one-hot actions of the agents that were active neighbours
    in that step. It is zero for an agent without neighbours and where a trajectory begins: an episode, a late
    arrival, a column that another agent takes over.

    Args:
        env: An environment in which all agents have A discrete actions.
        graph: Which agents are neighbours.
    """

    def __init__(self, env: VectorJointEnv, graph: Graph) -> None:
        self.num_envs, self._env = env.num_envs, env
        self._neighbourhood = Neighbourhood(env.spaces, graph)
        self._actions = common_actions(env.spaces)
        seen = Box(0.0, 1.0, (self._actions,), np.float32)
        self.spaces = env.spaces._replace(
            blocks=tuple(
                b._replace(observation={**b.observation, MEAN_ACTION: seen}) for b in env.spaces.blocks
            )
        )
        self._columns = columns_of(env.spaces.blocks)
        self._means: Floats = np.zeros((self.num_envs, self._columns[-1].stop, self._actions), np.float32)
        self._alive: Bools = np.zeros(self._means.shape[:2], bool)
        self._neighbours = torch.zeros(*self._alive.shape, self._alive.shape[1], dtype=torch.bool)

    def reset(self, seed: int, indices: Ints, *, stride: int = 0) -> JointStep:
        """Start all environments; nothing has been done yet. See `VectorJointEnv.reset`."""
        step = self._env.reset(seed, indices, stride=stride)
        self._means = np.zeros_like(self._means)
        return self._shown(step)

    def step(self, actions: tuple[np.ndarray, ...]) -> JointStep:
        """Act in all environments."""
        acted = self._alive[..., None]
        done = np.concatenate([self._one_hot(k, part) for k, part in enumerate(actions)], 1)
        means = mean_over(self._neighbours, torch.from_numpy(done * acted)).numpy() * acted
        step = self._env.step(actions)
        final = step.final
        if final is not None:
            final = final._replace(observations=self._with_means(final.observations, means[final.rows]))
        # Trajectories begin in an environment that was reset, and in a column that ended and is taken over.
        born = step.reset[:, None] | (step.alive & (step.terminated | step.truncated))
        born[list(step.failed)] = True
        self._means = np.where(born[..., None], 0, means).astype(np.float32)
        return self._shown(step._replace(final=final))

    def recreate(self, failures: Mapping[int, BaseException]) -> JointStep:
        """Replace environments by fresh ones."""
        step = self._env.recreate(failures)
        self._means[list(failures)] = 0
        return self._shown(step)

    def __getattr__(self, name: str) -> Any:
        """Return what the environment may have beside: `annotate`, `worlds`."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._env, name)

    @property
    def name(self) -> str:
        """The class of the environment."""
        return name_of(self._env)

    def close(self) -> None:
        """Release all resources."""
        self._env.close()

    def get_state(self) -> dict[str, Any] | None:
        """Return the state of the environment and the last actions, or None where it has none."""
        state = getattr(self._env, "get_state", lambda: None)()
        if state is None:
            return None
        return {
            "env": state,
            "means": self._means.copy(),
            "alive": self._alive.copy(),
            "neighbours": self._neighbours.numpy().copy(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue where `get_state` was called."""
        self._env.set_state(state["env"])  # type: ignore[attr-defined]
        self._means, self._alive = state["means"].copy(), state["alive"].copy()
        self._neighbours = torch.from_numpy(state["neighbours"].copy())

    def _shown(self, step: JointStep) -> JointStep:
        self._alive = step.alive.copy()
        graph = None if step.graph is None else torch.from_numpy(step.graph)
        seen = [{name: torch.from_numpy(x) for name, x in leaves.items()} for leaves in step.observations]
        self._neighbours = self._neighbourhood(torch.from_numpy(self._alive), graph, seen).clone()
        return step._replace(observations=self._with_means(step.observations, self._means))

    def _with_means(self, observations, means: Floats):
        return tuple(
            {**leaves, MEAN_ACTION: means[:, columns]}
            for leaves, columns in zip(observations, self._columns, strict=True)
        )

    def _one_hot(self, block: int, actions: np.ndarray) -> Floats:
        start = int(self.spaces.blocks[block].action.start)  # type: ignore[union-attr]
        return np.eye(self._actions, dtype=np.float32)[actions - start]
