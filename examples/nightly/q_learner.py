"""An algorithm from scratch, a plain Q-learner with a target network, trained on the loop."""

import ray
import torch
from ray.tune import register_env

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.config import JointConfig
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import JointModule
from algorithms.parts.distributions import EpsilonGreedyHead
from algorithms.parts.masking import MASKED_LOGIT
from algorithms.registry import ActionKind, Entry, Paradigm
from algorithms.settings import Fraction, OffPolicySettings
from smarts.env import VectorHiWayEnv


class MyModule(JointModule):
    """Q values: the default `body(encoder(observations))`, and copies of both as targets."""

    targets = ("target_encoder", "target_body")

    def make_head(self):
        """Say how outputs become actions."""
        return EpsilonGreedyHead(self.group.action)


class MyLearner(OffPolicyLearner):
    """The paper's pseudo-code."""

    def update_minibatch(self, batch):
        """Step each group's network towards its targets."""
        for group, own in batch.present():  # own.observations, own.actions, ...: (M, n, ...)
            net = self.net(group.id)
            with torch.no_grad():
                values = net.target_body(net.target_encoder(own.next.observations))
                if own.next.action_mask is not None:
                    values = values.masked_fill(~own.next.action_mask, MASKED_LOGIT)
                following = torch.where(own.bootstrap, values.amax(-1), 0)
            chosen = net.policy(own).gather(-1, own.actions.unsqueeze(-1)).squeeze(-1)
            error = (chosen - own.rewards - self.gamma * following).square()
            self.step_optimizer(self.mean(error, own.alive), group.id)  # this network and no other
        self.polyak_update(*(g.id for g in self.groups), tau=self.config.tau)  # target_x follows x


class MySettings(OffPolicySettings):
    """Its settings: keywords of training(), keys of experiment files."""

    epsilon: Fraction = 0.1
    """Probability of a random action."""


class MyConfig(JointConfig):
    """Its RLlib config."""

    algorithm = "mine"
    # In this library it is a line in `algorithms/registry.py` instead.
    entry = Entry("q_learner:MyConfig", MySettings, Paradigm.DECENTRALISED, "M1", ActionKind.DISCRETE)
    policy_module = MyModule
    explores_by = "epsilon"


class Mine(JointAlgorithm):
    """The algorithm: its config and its learner."""

    config_class = MyConfig
    learner_class = MyLearner


def main():
    """Train it for two iterations."""
    ray.init(address="local", num_cpus=2, include_dashboard=False, ignore_reinit_error=True)
    register_env("loop", lambda config: VectorHiWayEnv(config["num_envs"], ["loop"], 2))
    config = MyConfig().environment("loop").env_runners(num_env_runners=0, num_envs_per_env_runner=2)
    algo = config.training(sharing="all", epsilon=0.2, learning_starts=50).build_algo()
    try:
        for _ in range(2):
            steps = algo.train()["env_runners"]["num_env_steps_sampled"]
            print(f"{steps:.0f} steps")
    finally:
        algo.stop()
        ray.shutdown()


if __name__ == "__main__":
    main()
