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


class A2CConfig(PPOConfig):
    """Independent A2C."""

    algorithm = "a2c"

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class or A2C)
        # Without a ratio, a second step on the same data would not be a policy gradient.
        self.training(epochs=1, minibatch_size=None, lr=1e-3)
        self.env_runners(rollout_fragment_length=16)

    def validate(self) -> None:
        """Refuse more than one step on a rollout (RLlib).

        Raises:
            ValueError: `epochs` or `minibatch_size` ask for more.
        """
        super().validate()
        if self.epochs != 1 or self.minibatch_size is not None:
            self._value_error(
                f"{self.algorithm!r} takes one step on each rollout, but epochs={self.epochs} and "
                f"minibatch_size={self.minibatch_size}: without a ratio the second would not be a policy "
                "gradient; leave both at 1 and None, or use 'ppo'"
            )

    def get_default_learner_class(self):
        """Return the learner (RLlib)."""
        return A2CLearner


class A2C(PPO):
    """Independent A2C."""

    @classmethod
    def get_default_config(cls) -> A2CConfig:
        """Return the defaults (RLlib)."""
        return A2CConfig()
