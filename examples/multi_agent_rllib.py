"""RLlib's own PPO on the intersection, by two remote runners, four agents with one policy; then our PPO."""

from typing import Any

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune import register_env

import algorithms
from smarts.env import RLlibHiWayEnv, VectorHiWayEnv

ENV_CONFIG = {"scenarios": ["intersection"], "agent_specs": 4, "seed": 42, "headless": True}


def stock(batch: int = 400) -> dict[str, Any]:
    """Train RLlib's PPO for an iteration; return its results."""
    config = (
        PPOConfig()
        .environment(RLlibHiWayEnv, env_config=ENV_CONFIG)
        .env_runners(num_env_runners=2)
        .multi_agent(policies={"shared"}, policy_mapping_fn=lambda agent, episode, **_: "shared")
        .training(train_batch_size=batch, minibatch_size=batch // 4, num_epochs=2)
    )
    algo = config.build_algo()
    try:
        return algo.train()
    finally:
        algo.stop()


def ours(batch: int = 400) -> dict[str, Any]:
    """Train this project's PPO for an iteration; return its results."""
    register_env("vector", lambda config: VectorHiWayEnv(config["num_envs"], ["intersection"], seed=42))
    config = algorithms.config("ppo").environment("vector")
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=batch // 8)
    config.training(sharing="all")
    algo = config.build_algo()
    try:
        return algo.train()
    finally:
        algo.stop()


def main() -> None:
    """Train both for an iteration."""
    ray.init(address="local", num_cpus=2, include_dashboard=False, ignore_reinit_error=True)
    for name, train in (("RLlib's PPO", stock), ("ours", ours)):
        results = train()["env_runners"]
        print(f"{name}: {results['num_env_steps_sampled']:.0f} steps")
    ray.shutdown()


if __name__ == "__main__":
    main()
