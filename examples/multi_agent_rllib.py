"""RLlib's own PPO on the intersection, by two remote runners, four agents with one policy."""

import ray
from ray.rllib.algorithms.ppo import PPOConfig

from smarts.env import RLlibHiWayEnv

ENV_CONFIG = {"scenarios": ["intersection"], "agent_specs": 4, "seed": 42, "headless": True}


def main(batch: int = 400) -> None:
    """Train for an iteration."""
    ray.init(address="local", num_cpus=2, include_dashboard=False, ignore_reinit_error=True)
    config = (
        PPOConfig()
        .environment(RLlibHiWayEnv, env_config=ENV_CONFIG)
        .env_runners(num_env_runners=2)
        .multi_agent(policies={"shared"}, policy_mapping_fn=lambda agent, episode, **_: "shared")
        .training(train_batch_size=batch, minibatch_size=batch // 4, num_epochs=2)
    )
    algo = config.build_algo()
    print(f"{algo.train()['env_runners']['num_env_steps_sampled']:.0f} steps")
    algo.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
