"""A custom algorithm: PPO with a second term in its policy loss, and a setting for it."""

import ray
from ray.tune import register_env

from algorithms.ppo import PPO, PPOConfig, PPOLearner
from algorithms.registry import ActionKind, Entry, Paradigm
from algorithms.settings import NotNegative, PPOSettings
from smarts.env import VectorHiWayEnv


class CautiousLearner(PPOLearner):
    """PPO whose policy loss also has the square of the log-probability."""

    def policy_loss(self, log_prob, old_log_prob, advantages):
        """Return the loss of each action."""
        loss = super().policy_loss(log_prob, old_log_prob, advantages)
        return loss + self.config.caution * log_prob.square()


class CautiousSettings(PPOSettings):
    """PPO's settings, and one more."""

    caution: NotNegative = 0.0
    """Weight of the square of log-probabilities."""


class CautiousConfig(PPOConfig):
    """Its RLlib config, with PPO's networks."""

    algorithm = "cautious"
    entry = Entry(
        "own_algorithm:CautiousConfig", CautiousSettings, Paradigm.DECENTRALISED, "M1", ActionKind.BOTH
    )


class Cautious(PPO):
    """The algorithm: its config and its learner."""

    config_class = CautiousConfig
    learner_class = CautiousLearner


def main():
    """Train it for an iteration."""
    ray.init(address="local", num_cpus=2, include_dashboard=False, ignore_reinit_error=True)
    register_env("loop", lambda config: VectorHiWayEnv(config["num_envs"], ["loop"], 2))
    config = CautiousConfig().environment("loop").training(sharing="all", caution=0.01)
    algo = config.env_runners(num_env_runners=0, num_envs_per_env_runner=2).build_algo()
    print(f"{algo.train()['env_runners']['num_env_steps_sampled']:.0f} joint decisions")
    algo.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
