"""RLlib configs of joint algorithms: settings with their defaults, and which networks exist."""

from __future__ import annotations

import inspect
import logging
import secrets
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from gymnasium.spaces import Box, Discrete
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.utils.metrics.metrics_logger import DEFAULT_STATS_CLS_LOOKUP
from ray.util.debug import log_once

from algorithms.errors import SpaceError, UnknownSettingError, nearest_names
from algorithms.joint.env import MEMORY, Block, VectorJointEnv
from algorithms.joint.metrics import EPISODE_MEAN, EpisodeMean
from algorithms.joint.module import JointModule, LearnerModule
from algorithms.joint.ranges import (
    COUNT,
    FRACTION,
    NOT_NEGATIVE,
    NUMBER,
    POSITIVE,
    WIDTH,
    Range,
    Ranges,
    Widths,
    faults,
)
from algorithms.joint.runner import SPEC, JointEnvRunner
from algorithms.joint.spec import Group, JointSpec, Sharing, agent_spaces
from algorithms.parts.distributions import Exploration
from algorithms.parts.schedule import Schedule
from algorithms.registry import ALGORITHMS, Actions, Entry

logger = logging.getLogger(__name__)


class JointConfig(AlgorithmConfig):
    """Settings of every joint algorithm; attributes below are keywords of `training()`.

    A subclass names its registry entry in `algorithm`, adds settings by `_defaults()`, says in `ranges` which
    values these may take (any, where it does not), and adds networks in `modules()`.

    Attributes:
        sharing: Who shares a policy network: "none", "all", {"group": ["agent", ...]}, or a function.
        hidden: Widths of hidden layers, of policies and critics alike; (): linear, where algorithms can.
        lr: Learning rate of all networks, or an RLlib schedule over environment steps.
        gamma: Discount per environment step.
        grad_clip: Largest gradient norm of each network, or None.
        reward_scale: Factor on rewards before learning; metrics show unscaled returns.
        max_env_failures: Failures of one copy without a completed episode in between that stop the run.
        max_silent_iterations: Requests in a row without any runner's answer that stop the run.
        torch_threads: Threads that torch uses for acting and learning in each process.
        evaluate_sampled: Greedy evaluations also play the same episodes with sampled actions, below
            `sampled/`.
        gru: Width of the policies' memory (gated recurrent units), for algorithms that are tagged recurrent;
            0: no memory.
        sequence_length: Steps through which recurrent policies are differentiated; divides
            `rollout_fragment_length`.
    """

    algorithm: str
    interchangeable: ClassVar[tuple[str, ...]] = ()
    """Settings of networks that a checkpoint may be restored under another value of."""
    ranges: ClassVar[Ranges] = {
        "hidden": Widths(),
        "lr": FRACTION._replace(scheduled=True),
        "gamma": FRACTION,
        "grad_clip": POSITIVE._replace(optional=True),
        "reward_scale": POSITIVE,
        "max_env_failures": COUNT,
        "max_silent_iterations": COUNT,
        "torch_threads": COUNT,
        "gru": WIDTH._replace(low=0),
        "sequence_length": COUNT,
    }

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class)
        self.env_runner_cls = JointEnvRunner
        self.env_runners(
            num_envs_per_env_runner=8, rollout_fragment_length=64, batch_mode="truncate_episodes"
        )
        # RLlib's default mapping cannot be called without its own runner; ours lies in the JointSpec.
        self.multi_agent(policies={"shared"}, policy_mapping_fn=_unused_mapping)  # type: ignore[arg-type]
        self.fault_tolerance(restart_failed_env_runners=True, delay_between_env_runner_restarts_s=0.1)
        self.evaluation(evaluation_duration_unit="episodes", evaluation_config={"explore": False})
        self.reporting(
            metrics_num_episodes_for_smoothing=100,
            custom_stats_cls_lookup={**DEFAULT_STATS_CLS_LOOKUP, EPISODE_MEAN: EpisodeMean},
        )
        self.explore = True
        self._defaults(
            sharing="none",
            hidden=(64, 64),
            lr=3e-4,
            gamma=0.99,
            grad_clip=10.0,
            reward_scale=1.0,
            max_env_failures=10,
            max_silent_iterations=3,
            torch_threads=1,
            evaluate_sampled=False,
            gru=0,
            sequence_length=16,
        )

    sharing: Sharing
    hidden: tuple[int, ...]
    reward_scale: float
    max_env_failures: int
    max_silent_iterations: int
    torch_threads: int
    evaluate_sampled: bool
    gru: int
    sequence_length: int

    @property
    def setting_names(self) -> tuple[str, ...]:
        """The algorithm's own keywords of `training()`."""
        return self._settings

    @property
    def entry(self) -> Entry:
        """The algorithm's line in the registry."""
        return ALGORITHMS[self.algorithm]

    def training(self, **settings: Any) -> Self:  # type: ignore[override]
        """Change settings of the algorithm, or RLlib's general ones.

        Raises:
            UnknownSettingError: Neither has a setting of this name.
        """
        general = inspect.signature(AlgorithmConfig.training).parameters
        for name in settings:
            if name not in self._settings and name not in general:
                known = [*self._settings, *(n for n in general if n != "self")]
                raise UnknownSettingError(
                    f"{self.algorithm!r} has no setting {name!r}",
                    place="training()",
                    remedy=nearest_names(name, known),
                )
        own = {name: value for name, value in settings.items() if name in self._settings}
        super().training(**{name: value for name, value in settings.items() if name not in own})
        for name, value in own.items():
            setattr(self, name, value)
        return self

    def modules(self, spec: JointSpec) -> dict[str, RLModuleSpec]:
        """Return the networks by module id: one policy per group, under the group's id, and critics.

        Use `policy_spec` and `learner_spec` to describe them.
        """
        raise NotImplementedError

    def module_settings(self) -> dict[str, Any]:
        """Return the settings that networks are built from."""
        return {"hidden": tuple(self.hidden)}

    def identity(self) -> dict[str, Any]:
        """Return what a checkpoint's weights depend on besides agents and spaces, in plain comparable values.

        These are the settings that networks are built from; those in `interchangeable` are left out.
        """
        built = {"algorithm": self.algorithm, **self.module_settings(), "gru": self.gru}
        return {name: value for name, value in built.items() if name not in self.interchangeable}

    def carried(self, block: Block) -> dict[str, Box]:
        """Return the leaves that the sampler adds to the observations of a block's agents."""
        return {MEMORY: Box(-1.0, 1.0, (self.gru,), np.float32)} if self.gru else {}

    def adapt(self, env: VectorJointEnv) -> VectorJointEnv:
        """Return the environment as this algorithm's agents see it."""
        return env

    def exploration(self, steps: int) -> Exploration:  # type: ignore[override] - RLlib's is of its old stack
        """Return how runners explore after this many environment steps."""
        return Exploration(explore=bool(self.explore))

    def policy_spec(
        self, spec: JointSpec, group: Group, module: type[JointModule] = JointModule
    ) -> RLModuleSpec:
        """Describe a policy network of a group."""
        observation, action = agent_spaces(group)
        return RLModuleSpec(
            module_class=module,
            observation_space=observation,
            action_space=action,
            model_config={"spec": spec, "group": group.id, "settings": self.module_settings()},
        )

    def learner_spec(
        self, spec: JointSpec, module: type[LearnerModule], group: Group | None = None
    ) -> RLModuleSpec:
        """Describe a network that only learners hold, of one group or of all agents."""
        observation, action = agent_spaces(group or spec.groups[0])
        return RLModuleSpec(
            module_class=module,
            observation_space=observation,
            action_space=action,
            learner_only=True,
            model_config={
                "spec": spec,
                "group": group.id if group else None,
                "settings": self.module_settings(),
            },
        )

    def check(self, spec: JointSpec) -> None:
        """Refuse environments that the algorithm cannot handle.

        Raises:
            SpaceError: An action space does not fit; the message names algorithms that do.
        """
        for block in spec.spaces.blocks:
            kind = Actions.DISCRETE if isinstance(block.action, Discrete) else Actions.CONTINUOUS
            if not self.entry.acts_in(kind):
                fitting = ", ".join(name for name, entry in ALGORITHMS.items() if entry.acts_in(kind))
                raise SpaceError(
                    f"{self.algorithm!r} needs {self.entry.actions} actions, "
                    f"but {block.agents[0]!r} has {block.action}",
                    place="action space",
                    remedy=f"for {kind} actions use one of: {fitting}",
                )

    def get_multi_rl_module_spec(
        self,
        *,
        env=None,
        spaces: Mapping[str, Any] | None = None,
        inference_only: bool = False,
        **kwargs: Any,
    ) -> MultiRLModuleSpec:
        """Return all networks, or those that runners need (RLlib)."""
        if not spaces or SPEC not in spaces:
            raise SpaceError(
                "the spaces of the environment are unknown",
                place=f"config of {self.algorithm!r}",
                remedy="give the environment: .environment(...)",
            )
        spec: JointSpec = spaces[SPEC][0]
        self.check(spec)
        modules = self.modules(spec)
        if inference_only:
            modules = {name: module for name, module in modules.items() if not module.learner_only}
            for module in modules.values():
                module.inference_only = True
        return MultiRLModuleSpec(rl_module_specs=modules)

    def get_default_rl_module_spec(self) -> RLModuleSpec:
        """Return what RLlib takes as the type of networks."""
        return RLModuleSpec(module_class=JointModule)

    def validate(self) -> None:
        """Refuse settings that cannot work together, and draw a seed where none was given (RLlib).

        Raises:
            ValueError: A number is out of its range; several learners, evaluation by time, fragments of
                automatic length, or a memory where the algorithm has none were asked for.
        """
        log_once(
            f"{getattr(self.algo_class, '__name__', None)}_on_new_api_stack"
        )  # there is no other stack to warn about
        super().validate()
        for fault in faults(type(self), {name: getattr(self, name) for name in self.setting_names}):
            self._value_error(fault)
        if self.seed is None:  # drawn once here, so that checkpoints and results tell it
            self.seed = secrets.randbits(31)
            logger.info("seed %d was drawn, since none was given", self.seed)
        if (self.num_learners or 0) > 1:
            self._value_error("joint algorithms learn in one process: set num_learners to 0 or 1")
        if not isinstance(self.rollout_fragment_length, int):
            self._value_error("rollout_fragment_length must be a number: 'auto' may differ between runners")
        if self.evaluation_interval and self.evaluation_duration == "auto":
            self._value_error(
                "evaluation_duration must be a number of episodes: scores would not be comparable"
            )
        if self.evaluation_interval and self.evaluation_duration_unit != "episodes":
            self._value_error("evaluation_duration_unit must be 'episodes': parts of episodes have no return")
        if self.gru and not self.in_evaluation:  # RLlib's copy for evaluation has fragments of one step
            self._check_recurrence()

    def _check_recurrence(self) -> None:
        if not self.entry.recurrent:
            fitting = ", ".join(name for name, entry in ALGORITHMS.items() if entry.recurrent)
            self._value_error(
                f"{self.algorithm!r} has no memory, so no gru={self.gru}; use one of: {fitting}"
            )
        if int(self.rollout_fragment_length) % self.sequence_length:
            self._value_error(
                f"rollout_fragment_length={self.rollout_fragment_length} is no multiple of "
                f"sequence_length={self.sequence_length}"
            )

    def _defaults(self, **settings: Any) -> None:
        self._settings: tuple[str, ...] = (*getattr(self, "_settings", ()), *settings)
        for name, value in settings.items():
            setattr(self, name, value)


class OnPolicyConfig(JointConfig):
    """Settings of algorithms that learn from each rollout once.

    Attributes:
        lambda_: Weight of longer returns in advantage estimation.
        epochs: Passes over each rollout.
        minibatch_size: Joint rows, of N correlated agents each, per gradient step; None: the whole rollout.
        normalize_advantages: Standardise advantages per policy network over each rollout.
        entropy_coeff: Weight of the entropy bonus, or an RLlib schedule over environment steps.
    """

    ranges: ClassVar[Ranges] = {
        "lambda_": FRACTION,
        "epochs": COUNT,
        "minibatch_size": COUNT._replace(optional=True),
        "entropy_coeff": NOT_NEGATIVE._replace(scheduled=True),
    }

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class)
        self._defaults(
            lambda_=0.95, epochs=4, minibatch_size=128, normalize_advantages=True, entropy_coeff=0.01
        )

    lambda_: float
    epochs: int
    normalize_advantages: bool
    entropy_coeff: Schedule


class OffPolicyConfig(JointConfig):
    """Settings of algorithms that learn from replay.

    Attributes:
        capacity: Joint transitions in the replay buffer.
        batch_size: Joint transitions, of N agents each, per update.
        learning_starts: Joint transitions stored before the first update.
        updates_per_step: Updates per environment step (of one copy).
        tau: Step of target networks towards their originals, each update.
        checkpoint_replay: Whether checkpoints hold the replay buffer; without it a restored run is not exact.
    """

    ranges: ClassVar[Ranges] = {
        "capacity": COUNT,
        "batch_size": COUNT,
        "learning_starts": NUMBER,
        "updates_per_step": POSITIVE,
        "tau": Range(0, 1, above=True),
    }

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class)
        self.env_runners(rollout_fragment_length=8)
        self.sequence_length = 8
        self._defaults(
            capacity=100_000,
            batch_size=128,
            learning_starts=1_000,
            updates_per_step=0.125,
            tau=0.01,
            checkpoint_replay=True,
        )

    capacity: int
    batch_size: int
    learning_starts: int
    updates_per_step: float
    tau: float
    checkpoint_replay: bool

    def validate(self) -> None:
        """Refuse settings that cannot work together (RLlib).

        Raises:
            ValueError: Learning would never start; see also `JointConfig.validate`.
        """
        super().validate()
        if self.learning_starts > self.capacity:
            self._value_error(
                f"learning_starts={self.learning_starts} is more than capacity={self.capacity}: "
                "nothing would ever be learnt"
            )


def _unused_mapping(agent_id: str, episode: Any = None, **kwargs: Any) -> str:
    return "shared"
