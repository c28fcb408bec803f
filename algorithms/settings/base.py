"""Settings that algorithms have in common."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from algorithms.settings.kinds import (
    Count,
    FirstAndLast,
    Fraction,
    NotNegative,
    Number,
    Positive,
    ScheduledFraction,
    ScheduledWeight,
    Sharing,
    Widths,
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
