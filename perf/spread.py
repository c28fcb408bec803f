"""Scores on mpe2's simple_spread_v3 (3 agents, default settings): PPO, centralised-V and MADDPG, three seeds.

    python perf/spread.py [--steps 150000] [--seeds 1 2 3] [--algorithms ppo centralised_v maddpg]

An agent's reward in a step is minus half of the sum over landmarks of the distance of the nearest agent,
minus half of the number of agents it touches (`local_ratio` 0.5); an episode has 25 steps. The return printed
is the undiscounted sum over the 25 steps and over the three agents, and beside it the same divided by three
("per agent"); both are means over 200 episodes of fixed worlds. Published figures use either, or a mean over
steps, and `local_ratio` differs, so they differ by factors.
"""

from __future__ import annotations

import argparse
import logging
import time
from typing import Any

import numpy as np
import ray
import torch
from mpe2 import simple_spread_v3
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune import register_env

import algorithms
from algorithms.joint.evaluation import evaluate

ON_POLICY = {"lr": 1e-3, "gamma": 0.95, "epochs": 8, "minibatch_size": 250, "hidden": (64, 64)}
SETTINGS: dict[str, dict[str, Any]] = {
    "ppo": ON_POLICY,
    "centralised_v": ON_POLICY,
    "maddpg": {"lr": 1e-3, "gamma": 0.95, "updates_per_step": 0.05, "batch_size": 256, "hidden": (64, 64)},
}
FRAGMENT = {"ppo": 125, "centralised_v": 125, "maddpg": 25}
ENVS, EPISODES = 8, 200


def built(name: str, seed: int) -> Any:
    """Return the algorithm, one network shared by all agents."""
    config = algorithms.config(name).environment("simple_spread").debugging(seed=seed)
    config.env_runners(
        num_env_runners=0, num_envs_per_env_runner=ENVS, rollout_fragment_length=FRAGMENT[name]
    )
    return config.training(sharing="all", **SETTINGS[name]).build_algo()


def score(algo: Any, *, explore: bool) -> float:
    """Return the mean over episodes of the return summed over agents."""
    return float(np.mean([e.returns.sum() for e in evaluate(algo, EPISODES, explore=explore)]))


def train(name: str, seed: int, steps: int) -> tuple[float, float, float, float]:
    """Return (score before, greedy score, sampled score, seconds of training)."""
    algo = built(name, seed)
    before, start = score(algo, explore=True), time.perf_counter()
    for _ in range(-(-steps // (ENVS * FRAGMENT[name]))):
        algo.train()
    seconds = time.perf_counter() - start
    greedy, sampled = score(algo, explore=False), score(algo, explore=True)
    algo.stop()
    return before, greedy, sampled, seconds


def main() -> None:
    """Train and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=150_000, help="environment steps of each run")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--algorithms", nargs="+", default=list(SETTINGS), choices=list(SETTINGS))
    arguments = parser.parse_args()
    logging.getLogger("ray").setLevel(logging.ERROR)
    torch.set_num_threads(1)
    ray.init(address="local", num_cpus=1, include_dashboard=False, logging_level=logging.ERROR)
    register_env("simple_spread", lambda config: ParallelPettingZooEnv(simple_spread_v3.parallel_env()))
    print(f"{arguments.steps:,} environment steps, return summed over 3 agents (per agent)")
    for name in arguments.algorithms:
        scores = []
        for seed in arguments.seeds:
            before, greedy, sampled, seconds = train(name, seed, arguments.steps)
            scores.append((before, greedy, sampled))
            print(
                f"{name:14s} seed {seed}: untrained {before:8.1f}  greedy {greedy:8.1f} ({greedy / 3:6.1f})"
                f"  sampled {sampled:8.1f}  {seconds:6.0f} s",
                flush=True,
            )
        before, greedy, sampled = np.mean(scores, 0)
        print(f"{name:14s} mean  : untrained {before:8.1f}  greedy {greedy:8.1f} ({greedy / 3:6.1f})", end="")
        print(f"  sampled {sampled:8.1f}", flush=True)
    ray.shutdown()


if __name__ == "__main__":
    main()
