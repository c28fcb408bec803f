"""The settings of all algorithms: a class for each, in which a field says type, default, range and meaning.

RLlib's configs take their defaults and checks from here, experiment files their errors and their schema, and
`smarts-bench algorithms NAME` its table. The module imports neither torch nor Ray.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    InstanceOf,
    Tag,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import PydanticCustomError

WIDEST, DEEPEST = 16_384, 100
"""Largest width of a layer, and number of layers: more is a typing error, or out of memory."""

Count = Annotated[int, Field(ge=1)]
Number = Annotated[int, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Width = Annotated[int, Field(ge=1, le=WIDEST)]
# YAML has lists only, which a strict tuple refuses.
LIST = Field(strict=False)
Widths = Annotated[tuple[Width, ...], Field(max_length=DEEPEST), LIST]
SomeWidths = Annotated[tuple[Width, ...], Field(min_length=1, max_length=DEEPEST), LIST]
FirstAndLast = Annotated[tuple[Fraction, Fraction], LIST]


@dataclass(frozen=True)
class Near:
    """Agents within a distance of each other are neighbours.

    Attributes:
        radius: Largest distance, in the unit of the positions.
        leaf: Observation leaf that holds each agent's position.
        components: Places of the coordinates in the flattened leaf.
    """

    radius: float
    leaf: str = ""
    components: tuple[int, ...] = (0, 1)


PLAIN, POINTS, GROUPS, FUNCTION, PAIRS, NEAR = (
    Tag(name) for name in ("plain", "points", "groups", "function", "pairs", "near")
)
TAGS = {tag.tag for tag in (PLAIN, POINTS, GROUPS, FUNCTION, PAIRS, NEAR)}


def _choose(kinds: dict[Tag, Any]) -> Discriminator:
    """Check a value against the alternative of its Python type, so that it has one error and not several."""

    def tag_of(value: object) -> str:
        return next((tag.tag for tag, kind in kinds.items() if isinstance(value, kind)), PLAIN.tag)

    return Discriminator(tag_of)


def _rising(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    steps = [step for step, _ in points]
    if not steps or steps[0] != 0 or any(later <= earlier for earlier, later in pairwise(steps)):
        raise PydanticCustomError(
            "schedule", "Input should be points whose steps begin at 0 and rise: [[0, 0.01], [10000, 0.001]]"
        )
    return points


SCHEDULE = _choose({POINTS: list | tuple})
"""A number, or points [environment step, value] that straight lines join, as RLlib writes schedules."""
FractionPoint = Annotated[tuple[NotNegative, Fraction], LIST]
WeightPoint = Annotated[tuple[NotNegative, NotNegative], LIST]
ScheduledFraction = Annotated[
    Annotated[Fraction, PLAIN] | Annotated[tuple[FractionPoint, ...], LIST, AfterValidator(_rising), POINTS],
    SCHEDULE,
]
ScheduledWeight = Annotated[
    Annotated[NotNegative, PLAIN] | Annotated[tuple[WeightPoint, ...], LIST, AfterValidator(_rising), POINTS],
    SCHEDULE,
]
Members = Annotated[tuple[str, ...], LIST]
Sharing = Annotated[
    Annotated[Literal["none", "all"], PLAIN]
    | Annotated[dict[str, Members], GROUPS]
    | SkipJsonSchema[Annotated[Callable[[str], str], FUNCTION]],
    _choose({GROUPS: dict, FUNCTION: Callable}),
]
Pair = Annotated[tuple[str, str], LIST]
Graph = Annotated[
    Annotated[Literal["auto", "environment", "all", "ring"], PLAIN]
    | Annotated[tuple[Pair, ...], LIST, PAIRS]
    | SkipJsonSchema[Annotated[InstanceOf[Near], NEAR]],
    _choose({PAIRS: list | tuple, NEAR: Near}),
]


def _check_heads(heads: int, hidden: tuple[int, ...]) -> None:
    if hidden[-1] % heads:
        raise ValueError(f"attention_heads={heads} does not divide the last of hidden={hidden}")


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
    hidden: Widths = (64, 64)
    """Widths of hidden layers, of policies and critics alike; empty: linear, where algorithms can."""
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
    gru: Annotated[int, Field(ge=0, le=WIDEST)] = 0
    """Width of the policies' memory (gated recurrent units), for recurrent algorithms; 0: no memory."""
    sequence_length: Count = 16
    """Steps through which recurrent policies are differentiated; divides `rollout_fragment_length`."""
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

    @model_validator(mode="after")
    def _sequences_fit(self) -> Self:
        if self.gru and self.rollout_fragment_length % self.sequence_length:
            raise ValueError(
                f"rollout_fragment_length={self.rollout_fragment_length} is not a multiple of "
                f"sequence_length={self.sequence_length}"
            )
        return self


class OnPolicySettings(JointSettings):
    """Settings of algorithms that learn from each rollout once."""

    lambda_: Fraction = 0.95
    """Weight of longer returns in generalised advantage estimation."""
    epochs: Count = 4
    """Passes over each rollout."""
    minibatch_size: Count | None = 128
    """Joint rows, of N correlated agents each, per gradient step; null: the whole rollout."""
    normalize_advantages: bool = True
    """Whether advantages are standardised per policy network over each rollout."""
    entropy_coeff: ScheduledWeight = 0.01
    """Weight of the entropy bonus, or a schedule over environment steps."""


class OffPolicySettings(JointSettings):
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
    tau: Annotated[float, Field(gt=0, le=1)] = 0.01
    """Step of target networks towards their originals, each update (polyak averaging)."""
    checkpoint_replay: bool = True
    """Whether checkpoints hold the replay buffer; without it a restored run is not exact."""

    @model_validator(mode="after")
    def _learning_starts(self) -> Self:
        if self.learning_starts > self.capacity:
            raise ValueError(
                f"learning_starts={self.learning_starts} is more than capacity={self.capacity}: "
                "learning would never start"
            )
        return self


class PPOSettings(OnPolicySettings):
    """Independent PPO."""

    clip: Positive = 0.2
    """Largest rewarded change of an action's probability ratio."""
    normalize_values: bool = False
    """Whether critics fit standardised targets."""


class CentralisedVSettings(PPOSettings):
    """MAPPO."""

    normalize_values: bool = True


class HAPPOSettings(CentralisedVSettings):
    """HAPPO."""

    sharing: Literal["none"] = "none"  # type: ignore[reportIncompatibleVariableOverride]
    """Always "none": a step of a shared network changes all agents at once; 'centralised_v' shares."""


class RecurrentIPPOSettings(PPOSettings):
    """Recurrent IPPO."""

    gru: Annotated[int, Field(ge=1, le=WIDEST)] = 64
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
        _check_heads(self.attention_heads, self.hidden)
        return self


class A2CSettings(PPOSettings):
    """Independent A2C."""

    lr: ScheduledFraction = 1e-3
    rollout_fragment_length: Count = 16
    epochs: Literal[1] = 1  # type: ignore[reportIncompatibleVariableOverride]
    """One: without a ratio, a second step on the same data is no policy gradient; 'ppo' takes more."""
    minibatch_size: None = None  # type: ignore[reportIncompatibleVariableOverride]
    """Always the whole rollout; 'ppo' takes minibatches."""


class PGSettings(A2CSettings):
    """Independent policy gradient."""

    rollout_fragment_length: Count = 64
    baseline: bool = True
    """Whether a learned value is subtracted from the returns."""
    longest_trajectory: Count = 10_000
    """Most steps of a trajectory: nothing is learned from it before it ends."""


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

    lr: ScheduledFraction = 5e-4
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


class EpsilonGreedySettings(OffPolicySettings):
    """Settings of algorithms that explore by random actions."""

    epsilon: FirstAndLast = (1.0, 0.05)
    """First and last probability of a random action."""
    epsilon_steps: NotNegative = 10_000
    """Environment steps from the first to the last."""


class DQNSettings(EpsilonGreedySettings):
    """Independent DQN."""

    double: bool = True
    """Whether the online network chooses the next action."""
    duelling: bool = True
    """Whether value and advantage have separate streams."""
    prioritised: bool = False
    """Whether transitions are drawn by their last temporal difference (Schaul et al. 2016); without `gru`."""
    priority_alpha: NotNegative = 0.6
    """Exponent of priorities: 0 is uniform."""
    priority_beta: NotNegative = 0.4
    """How far importance weights undo them: 1 entirely."""

    @model_validator(mode="after")
    def _priorities_fit(self) -> Self:
        if self.prioritised and self.gru:
            raise ValueError("prioritised replay ranks single transitions: set gru to 0")
        return self


class VDNSettings(DQNSettings):
    """VDN."""

    prioritised: Literal[False] = False  # type: ignore[reportIncompatibleVariableOverride]
    """Always False: the team's loss gives no agent's temporal difference; 'dqn' has prioritised replay."""
    team_reward: Literal["sum", "mean"] = "sum"
    """How rewards of the active agents are joined; "mean" where all get the same shared reward."""


class QMIXSettings(VDNSettings):
    """QMIX."""

    mixer_width: Width = 32
    """Hidden units of the mixer."""


class MAVENSettings(QMIXSettings):
    """MAVEN."""

    latents: Annotated[int, Field(ge=2, le=WIDEST)] = 16
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


class OpponentQSettings(EpsilonGreedySettings):
    """Q-learning with models of the other agents."""

    lr: ScheduledFraction = 1e-3
    model_steps: Count = 4
    """Gradient steps of the models of the other agents on each rollout."""


class PR2Settings(OpponentQSettings):
    """PR2-Q."""

    alpha: Positive = 0.1
    """Temperature of the others' expected answers, in scaled returns: the smaller, the surer."""


class MADDPGSettings(OffPolicySettings):
    """MADDPG."""

    lr: ScheduledFraction = 1e-3
    grad_clip: Positive | None = 0.5
    batch_size: Count = 256
    noise: NotNegative = 0.1
    """Standard deviation of exploration noise on continuous actions in [-1, 1]."""
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
        _check_heads(self.attention_heads, self.hidden)
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


class MeanFieldACSettings(MeanFieldSettings):
    """MF-AC."""

    entropy_coeff: ScheduledWeight = 0.01
    """Weight of the policies' entropy, in scaled returns, or a schedule over environment steps."""


class NetworkedQSettings(EpsilonGreedySettings):
    """Networked fitted Q-iteration."""

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


class SettingFault(NamedTuple):
    """A value that does not fit.

    Attributes:
        key: Name of the setting and places within its value; () for settings that do not fit each other.
        value: The value.
        problem: What it should be.
        is_unknown: Whether there is no such setting.
    """

    key: tuple[str | int, ...]
    value: Any
    problem: str
    is_unknown: bool

    def __str__(self) -> str:
        """Return name, value and problem, as in "lr[0][1]=3: Input should be ..."."""
        name, *places = self.key or ("",)
        where = str(name) + "".join(f"[{place}]" for place in places)
        return f"{where}={self.value!r}: {self.problem}" if self.key else self.problem


def faults(settings: type[JointSettings], values: dict[str, Any]) -> list[SettingFault]:
    """Return what is wrong with values of an algorithm's settings."""
    try:
        settings.model_validate(values)
    except ValidationError as error:
        return [
            SettingFault(
                tuple(part for depth, part in enumerate(each["loc"]) if depth != 1 or part not in TAGS),
                each["input"],
                each["msg"].removeprefix("Value error, ").replace("valid tuple", "list"),
                each["type"] == "extra_forbidden",
            )
            for each in error.errors(include_url=False)
        ]
    return []
