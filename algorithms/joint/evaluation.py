"""Evaluation of exact episodes, greedy or sampled, in any environment, without RLlib's metrics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from algorithms.joint.env import VectorJointEnv
from algorithms.joint.episode_indices import FIRST_TEST_EPISODE
from algorithms.joint.progress import Episode
from algorithms.joint.runner import JointEnvRunner

if TYPE_CHECKING:
    from algorithms.joint.algorithm import JointAlgorithm


def evaluate(
    algo: JointAlgorithm,
    episodes: int,
    *,
    explore: bool = False,
    first_episode: int = FIRST_TEST_EPISODE,
    env: VectorJointEnv | None = None,
    seed: int | None = None,
) -> list[Episode]:
    """Play `episodes` episodes with the present policies, in this process.

    Args:
        algo: A built algorithm; its training is left alone.
        episodes: Number of episodes; episode k has the index `first_episode + k`, whatever the number of
            environments or runners.
        explore: Sample actions as in training, from one stream for all environments, or act greedily.
        first_episode: Index of the first episode.
        env: Environment to play in, by default one like those of training; left open.
        seed: Root seed of the episodes and of sampled actions, by default the algorithm's own. One seed for
            all trainings makes their episodes begin alike.

    Raises:
        SpaceError: `env` has other agents or spaces than the algorithm.

    Returns:
        The episodes in the order of their indices; an episode that failed in an environment which then
        continues with another index, as the benchmark's does, is missing.
    """
    runner: JointEnvRunner = algo.env_runner_group.local_env_runner
    runner.set_state(algo.runner_state())
    indices = first_episode + np.arange(episodes)
    return runner.play(indices, explore=explore, env=env, seed=seed)
