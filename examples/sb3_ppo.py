"""PPO of Stable-Baselines3: one agent at the intersection, before and after a short training."""

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from smarts.env import SingleHiWayEnv


def main(steps: int = 4096, scenario: str = "intersection") -> tuple[float, float]:
    """Train for some steps; return the mean return before and after."""
    # Each of the four environments gets a seed of its own, and so episodes of its own.
    envs = make_vec_env(SingleHiWayEnv, n_envs=4, seed=42, env_kwargs={"scenarios": [scenario]})
    try:
        model = PPO("MlpPolicy", envs, n_steps=256, batch_size=256, seed=0, device="cpu")
        before, _ = evaluate_policy(model, envs, n_eval_episodes=20)
        model.learn(steps)
        after, _ = evaluate_policy(model, envs, n_eval_episodes=20)
    finally:
        envs.close()
    print(f"mean return {before:.2f} before, {after:.2f} after {steps} steps")
    return before, after


if __name__ == "__main__":
    main()
