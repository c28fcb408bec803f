"""Independent advantage actor-critic (A2C, "IAC").

Mnih et al. 2016, "Asynchronous Methods for Deep Reinforcement Learning", synchronous and per agent: the
policy gradient grad log pi(a_i | o_i) A_i with a learned value V(o_i), one step on each rollout. Foerster et
al. 2018 call it independent actor-critic.

Deviations: advantages by generalised advantage estimation instead of n-step returns (`lambda_=1` gives
those); Adam instead of RMSProp; separate networks for policy and value.
"""

from __future__ import annotations

from torch import Tensor

from algorithms.ppo import PPO, PPOConfig, PPOLearner


class A2CLearner(PPOLearner):
    """PPO's loop without its ratio, which is 1 in the only step that is taken."""

    def policy_loss(self, log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor) -> Tensor:
        """Return the loss of each action, whose gradient is the policy gradient."""
        return -log_prob * advantages

    def change(self, log_prob: Tensor, old_log_prob: Tensor) -> dict[str, Tensor]:
        """Return nothing: the policy that learns is the one that acted."""
        return {}


class A2CConfig(PPOConfig):
    """RLlib config of independent A2C."""

    algorithm = "a2c"


class A2C(PPO):
    """Independent A2C."""

    config_class = A2CConfig
    learner_class = A2CLearner
