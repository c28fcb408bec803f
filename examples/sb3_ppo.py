"""PPO of Stable-Baselines3: one agent at the intersection, before and after a short training."""

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from smarts.env import SingleHiWayEnv


def main(steps: int = 8192, scenario: str = "intersection") -> None:
    """Train for some steps; print the mean return before and after."""
    torch.set_num_threads(1)  # on networks this small, more of them wait for each other: ten times as long
    # Each of the four environments gets a seed of its own, and so episodes of its own.
    envs = make_vec_env(SingleHiWayEnv, n_envs=4, seed=42, env_kwargs={"scenarios": [scenario]})
    try:
        settings = {"learning_rate": 1e-3, "n_steps": 128, "batch_size": 128}
        model = PPO("MlpPolicy", envs, **settings, seed=1, device="cpu")
        before, _ = evaluate_policy(model, envs, n_eval_episodes=20)
        print(f"mean return {before:.2f} before; training for {steps} steps", flush=True)
        model.learn(steps)
        after, _ = evaluate_policy(model, envs, n_eval_episodes=20)
    finally:
        envs.close()
    print(f"mean return {after:.2f} after {steps} steps")


if __name__ == "__main__":
    main()
