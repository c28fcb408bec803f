"""The settings of all algorithms: a class for each, in which a field says type, default, range and meaning.

RLlib's configs take their defaults and checks from here, experiment files their errors and their schema, and
`smarts-bench settings NAME` its table. The module imports neither torch nor Ray.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from algorithms.setting_kinds import (
    Count,
    FirstAndLast,
    FirstAndLastPositive,
    Fraction,
    Graph,
    NotNegative,
    Number,
    Place,
    Positive,
    ScheduledFraction,
    ScheduledWeight,
    Sharing,
    SomeWidths,
    Widths,
    check_heads,
)


class JointSettings(BaseModel):
    """What every algorithm can be set to; keywords of its config's `training()`, keys of experiment files.

    A field that a subclass gives another default keeps its meaning.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        use_attribute_docstrings=True,
        json_schema_extra=lambda schema, model: model.describe(schema),
    )

    sharing: Sharing = "none"
    """Agents that share a policy network: "none", "all", {group: [agent, ...]}, or in Python a function from
    agent to group."""
    identity: bool = True
    """Whether agents that share a network are told apart by an input, their one-hot place; critics of all
    agents' observations know in any case whose value they give."""
    hidden: Widths = (64, 64)
    """Widths of hidden layers, of policies and critics alike; empty: linear, where algorithms can."""
    set_width: Number = 0
    """Units of the networks for observations (K, F) that are sets of rows in any order, such as neighbors; 0:
    rows are read one after the other."""
    lr: ScheduledFraction = 3e-4
    """Learning rate of all networks, or a schedule over environment steps: [[0, 0.001], [10000, 0.0001]]."""
    gamma: Fraction = 0.99
    """Discount per environment step."""
    grad_clip: Positive | None = 10.0
    """Largest gradient norm of each network; null: any."""
    reward_scale: Positive = 1.0
    """Factor on rewards before learning; metrics show unscaled returns."""
    rollout_fragment_length: Count = 64
    """Environment steps of each environment between two updates."""
    gru: Number = 0
    """Width of the policies' memory (gated recurrent units), for recurrent algorithms; 0: no memory."""
    sequence_length: Count = 16
    """Steps through which policies with `gru` are differentiated; divides `rollout_fragment_length`."""
    max_env_failures: Count = 10
    """Failures of one environment without a completed episode in between that stop the run."""
    max_silent_iterations: Count = 3
    """Requests in a row without any runner's answer that stop the run."""
    torch_threads: Count = 1
    """Threads that torch uses for acting and learning in each process."""
    evaluate_sampled: bool = False
    """Whether greedy evaluations play the same episodes with sampled actions too, below `sampled/`."""

    @classmethod
    def meaning(cls, name: str) -> str:
        """Return what a setting means, as its nearest definition says."""
        kinds = (kind for kind in cls.__mro__ if issubclass(kind, JointSettings))
        meanings = (kind.model_fields[name].description for kind in kinds if name in kind.model_fields)
        return next((meaning for meaning in meanings if meaning), "")

    @classmethod
    def describe(cls, schema: dict[str, Any]) -> None:
        """Complete a JSON schema by the meanings of inherited settings."""
        for name, part in schema["properties"].items():
            part.setdefault("description", cls.meaning(name))
            part.pop("title", None)

    def check_unused(self, *names: str, used: bool, unless: str) -> None:
        """Raise if settings differ from their defaults but are not used.

        Args:
            names: The settings.
            used: Whether other settings make use of them.
            unless: What would make use of them.

        Raises:
            ValueError: They do.
        """
        for name in names:
            value = getattr(self, name)
            if not used and value != type(self).model_fields[name].default:
                raise ValueError(f"{name}={value!r} changes nothing unless {unless}: leave it out")

    @model_validator(mode="after")
    def _sequences_fit(self) -> Self:
        self.check_unused("sequence_length", used=self.gru > 0, unless="gru is above 0")
        if self.gru and self.rollout_fragment_length % self.sequence_length:
            raise ValueError(
                f"rollout_fragment_length={self.rollout_fragment_length} is not a multiple of "
                f"sequence_length={self.sequence_length}"
            )
        return self


class OnPolicySettings(JointSettings):
    """Settings of algorithms that learn from each rollout once."""

    epochs: Count = 4
    """Passes over each rollout."""
    minibatch_size: Count | None = 128
    """Joint rows, of N correlated agents each, per gradient step; null: the whole rollout."""
    normalize_advantages: bool = True
    """Whether advantages are standardised per policy network over each rollout."""
    entropy_coeff: ScheduledWeight = 0.01
    """Weight of the entropy bonus, or a schedule over environment steps."""
    normalize_values: bool = False
    """Whether critics fit standardised targets."""
    kl_to: Place | None = None
    """Folder of a run whose policy this one keeps near to, such as an imitated driver of the same observation
    and actions (Bakhtin et al. 2022; Cornelisse & Vinitsky 2024); null: none."""
    kl_coeff: ScheduledWeight = 0.1
    """Weight of the divergence from the policy of `kl_to`, or a schedule over environment steps."""

    @model_validator(mode="after")
    def _divergence_fits(self) -> Self:
        self.check_unused("kl_coeff", used=self.kl_to is not None, unless="kl_to names a run")
        return self


class ActorCriticSettings(OnPolicySettings):
    """Settings of algorithms whose critics estimate advantages."""

    lambda_: Fraction = 0.95
    """Weight of longer returns in generalised advantage estimation."""


class ReplaySettings(JointSettings):
    """Settings of algorithms that learn from replay."""

    rollout_fragment_length: Count = 8
    sequence_length: Count = 8
    capacity: Count = 100_000
    """Joint transitions in the replay buffer."""
    batch_size: Count = 128
    """Joint transitions, of N agents each, per update."""
    learning_starts: Number = 1_000
    """Joint transitions stored before the first update."""
    updates_per_step: Positive = 0.125
    """Updates per environment step (of one environment)."""
    checkpoint_replay: bool = True
    """Whether checkpoints hold the replay buffer; without it a restored run is not exact."""

    @model_validator(mode="after")
    def _learning_starts(self) -> Self:
        length = self.sequence_length if self.gru else 1
        kept = self.capacity - self.capacity % length
        if max(self.learning_starts, length) > kept:
            whole = f", of which whole sequences of sequence_length={length} take {kept}" if self.gru else ""
            raise ValueError(
                f"learning_starts={self.learning_starts} is more than capacity={self.capacity}{whole}: "
                "learning would never start"
            )
        return self


class OffPolicySettings(ReplaySettings):
    """Settings of algorithms that learn from replay, with target networks that follow in every update."""

    tau: Annotated[float, Field(gt=0, le=1)] = 0.01
    """Step of target networks towards their originals, each update (polyak averaging)."""


class RandomActionSettings(ReplaySettings):
    """Settings of algorithms that explore by random actions."""

    epsilon: FirstAndLast = (1.0, 0.05)
    """First and last probability of a random action."""
    epsilon_steps: NotNegative = 10_000
    """Environment steps from the first to the last."""


class EpsilonGreedySettings(OffPolicySettings, RandomActionSettings):
    """Settings of algorithms with target networks that explore by random actions."""


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
    identity: Literal[True] = True  # type: ignore[reportIncompatibleVariableOverride]
    """Always true: no agents share a network."""


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
    kl_to: None = None  # type: ignore[reportIncompatibleVariableOverride]
    """Always null."""
    kl_coeff: Literal[0.1] = 0.1  # type: ignore[reportIncompatibleVariableOverride]
    """Without effect: there is no policy to keep near to."""

    @model_validator(mode="after")
    def _heads_fit(self) -> Self:
        check_heads(self.attention_heads, self.hidden)
        return self


class BCSettings(JointSettings):
    """BC."""

    data: Place | None = None
    """Parquet file of demonstrations, as `smarts-bench demonstrations` writes; required."""
    sharing: Sharing = "all"
    identity: Literal[False] = False  # type: ignore[reportIncompatibleVariableOverride]
    """Always false: demonstrations are of single agents."""
    lr: ScheduledFraction = 1e-3
    batch_size: Count = 256
    """Decisions for a gradient step."""
    updates: Count = 100
    """Gradient steps of an iteration."""
    noise: NotNegative = 0.02
    """Standard deviation of normal noise on observations in training, against drift."""


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
    identity: Literal[False] = False  # type: ignore[reportIncompatibleVariableOverride]
    """Always false: as in the paper, agents that see the same do the same."""
    hidden: SomeWidths = (64, 64)
    """Widths of hidden layers; the last is the width of messages."""
    communication_steps: Number = 2
    """Layers that hear the others, K."""
    channel: bool = True
    """False: messages are dropped, which makes the agents independent."""
    value_coeff: NotNegative = 0.03
    """Weight of the baseline's error."""
    kl_to: None = None  # type: ignore[reportIncompatibleVariableOverride]
    """Always null."""
    kl_coeff: Literal[0.1] = 0.1  # type: ignore[reportIncompatibleVariableOverride]
    """Without effect: there is no policy to keep near to."""
    epochs: Count = 1  # type: ignore[reportIncompatibleVariableOverride]
    """Passes over each rollout; several steps on a rollout are PPO's."""
    minibatch_size: Count | None = None  # type: ignore[reportIncompatibleVariableOverride]
    """Joint rows, of N correlated agents each, per gradient step; null: the whole rollout."""
    clip: Positive = 0.2
    """Largest rewarded change of an action's probability ratio, where several steps are on a rollout."""

    @model_validator(mode="after")
    def _clip_fits(self) -> Self:
        several = self.epochs > 1 or self.minibatch_size is not None
        self.check_unused("clip", used=several, unless="epochs is above 1")
        return self


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
    identity: Literal[False] = False  # type: ignore[reportIncompatibleVariableOverride]
    """Always false: the order in which agents hand on tells them apart."""
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

    identity: Literal[True] = True  # type: ignore[reportIncompatibleVariableOverride]
    """Always true: every network reads all agents in their order."""
    lr: ScheduledFraction = 1e-3
    double: bool = True
    """Double Q-learning: the network itself chooses the joint action whose target value counts."""
    duelling: bool = True
    """Streams for the state's value and for advantages of joint actions."""
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
