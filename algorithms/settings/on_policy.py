"""Settings of the algorithms that learn from each rollout once."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from algorithms.settings.base import ActorCriticSettings, JointSettings, OnPolicySettings
from algorithms.settings.kinds import (
    Count,
    FirstAndLast,
    Fraction,
    NotNegative,
    Number,
    Positive,
    ScheduledFraction,
    Sharing,
    SomeWidths,
    check_heads,
)


class PPOSettings(ActorCriticSettings):
    """Independent PPO."""

    clip: Positive = 0.2
    """Largest rewarded change of an action's probability ratio."""


class CentralisedVSettings(PPOSettings):
    """MAPPO."""

    normalize_values: bool = True


class HAPPOSettings(CentralisedVSettings):
    """HAPPO."""

    sharing: Literal["none"] = "none"  # type: ignore[reportIncompatibleVariableOverride]
    """Always "none": a step of a shared network changes all agents at once; 'centralised_v' shares."""


class RecurrentIPPOSettings(PPOSettings):
    """Recurrent IPPO."""

    gru: Annotated[int, Field(ge=1)] = 64
    """Width of the memories of policies and critics."""
    sequence_length: Count = 8
    """Steps through which policies and critics are differentiated; divides `rollout_fragment_length`."""


class RecurrentMAPPOSettings(RecurrentIPPOSettings):
    """Recurrent MAPPO."""

    normalize_values: bool = True


class MATSettings(PPOSettings):
    """MAT."""

    sharing: Literal["all"] = "all"  # type: ignore[reportIncompatibleVariableOverride]
    """Always "all": one network maps all observations to all actions."""
    hidden: SomeWidths = (64, 64)
    """Widths of hidden layers; only the last counts, the width of embeddings."""
    normalize_values: bool = True
    blocks: Count = 1
    """Blocks of the encoder, and of the decoder."""
    attention_heads: Count = 1
    """Heads of the attention; they divide the last of `hidden`."""
    value_coeff: NotNegative = 1.0
    """Weight of the values' error."""

    @model_validator(mode="after")
    def _heads_fit(self) -> Self:
        check_heads(self.attention_heads, self.hidden)
        return self


class SingleStepSettings(OnPolicySettings):
    """Settings of policy gradients without a ratio, which take one step on each rollout."""

    lr: ScheduledFraction = 1e-3
    epochs: Literal[1] = 1  # type: ignore[reportIncompatibleVariableOverride]
    """One: without a ratio, a second step on the same data is no policy gradient; 'ppo' takes more."""
    minibatch_size: None = None  # type: ignore[reportIncompatibleVariableOverride]
    """Always the whole rollout; 'ppo' takes minibatches."""


class A2CSettings(SingleStepSettings, ActorCriticSettings):  # type: ignore[reportIncompatibleVariableOverride]
    """Independent A2C."""

    rollout_fragment_length: Count = 16


class PGSettings(SingleStepSettings):
    """Independent policy gradient."""

    baseline: bool = True
    """Whether a learned value is subtracted from the returns."""
    longest_trajectory: Count = 10_000
    """Most steps of a trajectory: nothing is learned from it before it ends."""

    @model_validator(mode="after")
    def _baseline_fits(self) -> Self:
        self.check_unused("normalize_values", used=self.baseline, unless="baseline is true")
        return self


class CommNetSettings(A2CSettings):
    """CommNet."""

    sharing: Sharing = "all"
    hidden: SomeWidths = (64, 64)
    """Widths of hidden layers; the last is the width of messages."""
    communication_steps: Number = 2
    """Layers that hear the others, K."""
    channel: bool = True
    """False: messages are dropped, which makes the agents independent."""
    value_coeff: NotNegative = 0.03
    """Weight of the baseline's error."""


class COMASettings(JointSettings):
    """COMA."""

    lr: ScheduledFraction = 1e-3
    rollout_fragment_length: Count = 16
    lambda_: Fraction = 0.8
    """Weight of longer returns in the critic's targets, TD(lambda)."""
    epsilon: FirstAndLast = (0.5, 0.02)
    """First and last share of uniformly random actions in the policies."""
    epsilon_steps: NotNegative = 10_000
    """Environment steps from the first to the last."""
    critic_steps: Count = 8
    """Steps of the critic on each rollout, before the policies' one."""
    tau: Annotated[float, Field(gt=0, le=1)] = 0.2
    """Step of the target critic towards its original, each rollout (polyak averaging)."""
    team_reward: Literal["sum", "mean"] = "sum"
    """How rewards of the active agents are joined; "mean" where all get the same shared reward."""
