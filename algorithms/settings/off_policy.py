"""Settings of the algorithms that learn from replay."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from algorithms.settings.base import EpsilonGreedySettings, OffPolicySettings, RandomActionSettings
from algorithms.settings.kinds import (
    Count,
    FirstAndLastPositive,
    Graph,
    NotNegative,
    Number,
    Positive,
    ScheduledFraction,
    ScheduledWeight,
    Sharing,
    SomeWidths,
    check_heads,
)


class QLearningSettings(EpsilonGreedySettings):
    """Settings of algorithms with a Q network for each group."""

    double: bool = True
    """Whether the online network chooses the next action."""
    duelling: bool = True
    """Whether value and advantage have separate streams."""


class DQNSettings(QLearningSettings):
    """Independent DQN."""

    prioritised: bool = False
    """Whether transitions are drawn by their last temporal difference (Schaul et al. 2016); without `gru`."""
    priority_alpha: NotNegative = 0.6
    """Exponent of priorities: 0 is uniform. With `prioritised` only."""
    priority_beta: NotNegative = 0.4
    """How far importance weights undo them: 1 entirely. With `prioritised` only."""

    @model_validator(mode="after")
    def _priorities_fit(self) -> Self:
        if self.prioritised and self.gru:
            raise ValueError("prioritised replay ranks single transitions: set gru to 0")
        self.check_unused(
            "priority_alpha", "priority_beta", used=self.prioritised, unless="prioritised is true"
        )
        return self


class TeamSettings(OffPolicySettings):
    """Settings of algorithms that fit a value of the team."""

    team_reward: Literal["sum", "mean"] = "sum"
    """How rewards of the active agents are joined; "mean" where all get the same shared reward."""
    standardize_rewards: bool = False
    """Whether the team's rewards get mean 0 and standard deviation 1 before they are scaled (`reward_scale`);
    by moments of about the transitions in replay, deviations below 0.01 counting as 0.01."""


class VDNSettings(QLearningSettings, TeamSettings):
    """VDN."""


class QMIXSettings(VDNSettings):
    """QMIX."""

    mixer_width: Count = 32
    """Hidden units of the mixer."""


class MAVENSettings(QMIXSettings):
    """MAVEN."""

    latents: Annotated[int, Field(ge=2)] = 16
    """Number of values of the latent that an episode commits to."""
    lambda_mi: NotNegative = 0.5
    """Weight of the mutual information between latent and behaviour."""
    latent_entropy: NotNegative = 0.2
    """Weight of the entropy of the policy that draws latents, beside standardised returns."""


class QTRANSettings(VDNSettings):
    """QTRAN."""

    variant: Literal["base", "alt"] = "base"
    """"base": the sum bounds the joint value from above; "alt": tightly in one of each agent's actions."""
    lambda_opt: NotNegative = 1.0
    """Weight of the constraint at the agents' best actions."""
    lambda_nopt: NotNegative = 1.0
    """Weight of the constraint elsewhere."""


class QDPPSettings(TeamSettings):
    """Q-DPP."""

    double: bool = True
    """Whether the online network chooses the next joint action."""
    duelling: bool = True
    """Whether value and advantage have separate streams."""
    features: Count = 32
    """Numbers in a diversity vector."""
    own_share: Annotated[float, Field(ge=1e-5, le=1)] = 1e-3
    """Share of a squared diversity vector in a direction that no other agent has, which bounds the penalty of
    equal vectors (of two agents: the logarithm of twice the share, in scaled returns); 1: the sum of VDN."""
    temperature: FirstAndLastPositive = (1.0, 0.05)
    """First and last temperature of the sampler, in scaled returns: 1 is the paper's, smaller is greedier."""
    temperature_steps: NotNegative = 10_000
    """Environment steps from the first to the last."""


class OpponentQSettings(EpsilonGreedySettings):
    """Q-learning with models of the other agents."""

    lr: ScheduledFraction = 1e-3
    model_steps: Count = 4
    """Gradient steps of the models of the other agents on each rollout."""


class PR2Settings(OpponentQSettings):
    """PR2-Q."""

    alpha: Positive = 0.1
    """Temperature of the others' expected answers, in scaled returns: the smaller, the surer."""


class ROMMEOSettings(OpponentQSettings):
    """ROMMEO-Q."""

    alpha: Positive = 0.1
    """Weight of the policy's entropy and of the distance of what is expected from what was seen, in scaled
    returns: the smaller, the more optimistic about the others."""


class MADDPGSettings(OffPolicySettings):
    """MADDPG."""

    lr: ScheduledFraction = 1e-3
    grad_clip: Positive | None = 0.5
    batch_size: Count = 256
    noise: NotNegative = 0.1
    """Standard deviation of exploration noise on continuous actions in [-1, 1]; with these only."""
    logit_penalty: NotNegative = 1e-3
    """Weight of the mean square of policy outputs, which keeps samples from freezing."""


class BiCNetSettings(MADDPGSettings):
    """BiCNet."""

    sharing: Sharing = "all"
    hidden: SomeWidths = (64, 64)
    """Widths of hidden layers; the last is the width of what agents hand on."""


class MAACSettings(OffPolicySettings):
    """MAAC."""

    hidden: SomeWidths = (64, 64)
    """Widths of hidden layers; the last is the width of embeddings."""
    lr: ScheduledFraction = 1e-3
    batch_size: Count = 256
    alpha: NotNegative = 0.01
    """Weight of the policies' entropy, in scaled rewards."""
    attention_heads: Count = 4
    """Heads of the critic's attention; they divide the last of `hidden`."""

    @model_validator(mode="after")
    def _heads_fit(self) -> Self:
        check_heads(self.attention_heads, self.hidden)
        return self


class MeanFieldSettings(OffPolicySettings):
    """Settings of both mean-field algorithms."""

    lr: ScheduledFraction = 1e-3
    graph: Graph = "auto"
    """Neighbours: "auto" (the environment's graph, else all agents), "environment", "all", "ring", pairs of
    agents, or in Python `Near`."""


class MeanFieldQSettings(MeanFieldSettings):
    """MF-Q."""

    temperature: Positive = 0.1
    """Temperature of the Boltzmann policy, in scaled returns: the smaller, the greedier."""
    update_at: Literal["acted_on", "same_step"] = "acted_on"
    """Mean action at which values are updated: the one acted on, of the step before, or that of the action's
    own step, as in the paper."""


class MeanFieldACSettings(MeanFieldSettings):
    """MF-AC."""

    entropy_coeff: ScheduledWeight = 0.01
    """Weight of the policies' entropy, in scaled returns, or a schedule over environment steps."""


class NetworkedQSettings(RandomActionSettings):
    """Networked fitted Q-iteration."""

    set_width: Literal[0] = 0  # type: ignore[reportIncompatibleVariableOverride]
    """Always 0: values are of all agents' observations side by side."""
    lr: ScheduledFraction = 1e-3
    grad_clip: Positive | None = None
    """Largest gradient norm of each network; null: any. A node that clips its own gradient no longer follows
    the team's."""
    graph: Graph = "auto"
    """Agents that exchange parameters: as `graph` of "mf_q"."""
    consensus: bool = True
    """False: the agents exchange nothing, and each fits its own reward."""
    fit_steps: Count = 50
    """Steps of a fit before its result gives the next targets."""
    agreement_rounds: Number = 8
    """Rounds of averaging at the end of a fit."""
    max_joint_actions: Count = 4096
    """Maximum number of joint actions."""

    @model_validator(mode="after")
    def _exchange_fits(self) -> Self:
        self.check_unused("graph", "agreement_rounds", used=self.consensus, unless="consensus is true")
        return self
