"""RLlib configs of joint algorithms: their settings as attributes, and which networks exist."""

from __future__ import annotations

import inspect
import logging
import secrets
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from gymnasium.spaces import Box, Discrete
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.utils.from_config import NotProvided
from ray.rllib.utils.metrics.metrics_logger import DEFAULT_STATS_CLS_LOOKUP
from ray.util.debug import log_once

from algorithms.errors import SpaceError
from algorithms.joint.checks import check_vectors
from algorithms.joint.env import MEMORY, AgentBlock, VectorJointEnv, name_of
from algorithms.joint.metrics import EPISODE_MEAN, EpisodeMean
from algorithms.joint.module import JointModule, LearnerModule, critic_of
from algorithms.joint.rllib_settings import (
    DEFAULT_POLICIES,
    OTHER_NAMES,
    MappedPolicies,
    check_known,
    check_policies,
    check_settings,
    network_settings,
)
from algorithms.joint.spec import SPEC, Group, JointSpec, agent_spaces, check_spaces
from algorithms.parts.distributions import Exploration
from algorithms.parts.schedule import annealed
from algorithms.registry import ALGORITHMS, ActionKind, Entry
from algorithms.setting_kinds import faults

logger = logging.getLogger(__name__)

ALL_STEPS = 2**62
"""More environment steps than any schedule has."""


class JointConfig(AlgorithmConfig):
    """RLlib config of a joint algorithm: its settings as attributes, and which networks exist.

    A subclass names its registry entry in `algorithm`, whose `settings` hold names, defaults and ranges, and
    the classes of its networks. Its algorithm names it in turn, see `JointAlgorithm`.
    """

    algorithm: str
    algorithm_class: ClassVar[Any] = None
    """Returns the `JointAlgorithm` of which this is the config; set by that class."""
    policy_module: ClassVar[type[JointModule]] = JointModule
    """The policy network of each group."""
    critic_module: ClassVar[type[LearnerModule] | None] = None
    """The critic of each group, if it has one of its own."""
    team_modules: ClassVar[Mapping[str, type[LearnerModule]]] = {}
    """Critics and mixers of all agents, by module id."""
    network_settings: ClassVar[tuple[str, ...]] = ()
    """Settings that networks are built from, beside `hidden`."""
    interchangeable: ClassVar[tuple[str, ...]] = ()
    """Settings with another value of which a checkpoint may be restored."""
    explores_by: ClassVar[str] = ""
    """The setting that says how far agents explore, a field of `Exploration`: a number, or the first and the
    last one, between which a setting `<name>_steps` anneals. Evaluation may have another."""

    def __init__(self, algo_class: type | None = None) -> None:
        algorithm = self.algorithm_class()
        super().__init__(algo_class or algorithm)
        self.env_runner_cls = algorithm.runner_class
        self.env_runners(num_envs_per_env_runner=8, batch_mode="truncate_episodes")
        # RLlib's default mapping cannot be called without its own runner; ours lies in the JointSpec.
        self.multi_agent(policies=DEFAULT_POLICIES, policy_mapping_fn=_unused_mapping)  # type: ignore[arg-type]
        self.fault_tolerance(restart_failed_env_runners=True, delay_between_env_runner_restarts_s=0.1)
        self.evaluation(evaluation_duration_unit="episodes", evaluation_config={"explore": False})
        self.reporting(
            metrics_num_episodes_for_smoothing=100,
            custom_stats_cls_lookup={**DEFAULT_STATS_CLS_LOOKUP, EPISODE_MEAN: EpisodeMean},
        )
        self.explore = True
        for name, value in self.entry.settings():
            setattr(self, name, value)

    if TYPE_CHECKING:
        entry: Entry  # a class attribute of a subclass that no registry has

        def __getattr__(self, name: str) -> Any:
            """Return the value of a setting."""

    @property
    def setting_names(self) -> tuple[str, ...]:
        """The algorithm's own keywords of `training()`."""
        return tuple(self.entry.settings.model_fields)

    if not TYPE_CHECKING:

        @property
        def entry(self) -> Entry:
            """The algorithm's line in the registry."""
            return ALGORITHMS[self.algorithm]

    def training(self, **settings: Any) -> Self:  # type: ignore[override]
        """Change settings of the algorithm, or RLlib's general ones.

        Raises:
            UnknownSettingError: Neither has a setting of this name.
        """
        general = [*inspect.signature(AlgorithmConfig.training).parameters][1:]
        check_known(self, settings, [*self.setting_names, *general], "training()")
        ours = {other: own for other, own in OTHER_NAMES.items() if own in self.setting_names}
        settings = {ours.get(name, name): value for name, value in settings.items()}
        own = settings.keys() & self.setting_names
        super().training(**{name: value for name, value in settings.items() if name not in own})
        return self._set({name: settings[name] for name in own})

    def multi_agent(self, **settings: Any) -> Self:  # type: ignore[override]
        """Change RLlib's settings of several agents; a `policy_mapping_fn` becomes `sharing`."""
        super().multi_agent(**settings)
        if self.policy_mapping_fn not in (_unused_mapping, AlgorithmConfig.DEFAULT_POLICY_MAPPING_FN):
            self.sharing = MappedPolicies(self.policy_mapping_fn)  # type: ignore[arg-type]
            self.policy_mapping_fn = _unused_mapping
        return self

    def rl_module(self, *, model_config: Any = NotProvided, **settings: Any) -> Self:  # type: ignore[override]
        """Change RLlib's settings of networks; `model_config` may hold `fcnet_hiddens`, `hidden` and `gru`.

        Raises:
            UnknownSettingError: It holds something else.
        """
        super().rl_module(**settings)
        return self._set({} if model_config is NotProvided else network_settings(model_config))

    def _set(self, settings: Mapping[str, Any]) -> Self:
        for name, value in settings.items():
            setattr(self, name, value)
        return self

    def get_state(self) -> dict[str, Any]:
        """Return all settings as they are; RLlib leaves out those of -1 and opens `PolicySpec`s."""
        names = vars(self).keys() - {"algo_class", "_is_frozen"}
        return {**super().get_state(), **{name: vars(self)[name] for name in names}}

    def modules(self, spec: JointSpec) -> dict[str, RLModuleSpec]:
        """Return the networks by module id: the policies under the groups' ids, then critics and mixers.

        An algorithm that needs others overrides it, by `policy_spec` and `learner_spec`.
        """
        networks = {g.id: self.policy_spec(spec, g, self.policy_module) for g in spec.groups}
        if self.critic_module is not None:
            networks |= {critic_of(g): self.learner_spec(spec, self.critic_module, g) for g in spec.groups}
        return networks | {name: self.learner_spec(spec, net) for name, net in self.team_modules.items()}

    def module_settings(self) -> dict[str, Any]:
        """Return the settings that networks are built from."""
        return {"hidden": tuple(self.hidden), **{name: getattr(self, name) for name in self.network_settings}}

    def checkpoint_signature(self) -> dict[str, Any]:
        """Return what a checkpoint's weights depend on besides agents and spaces, in plain comparable values.

        These are the settings that networks are built from; those in `interchangeable` are left out.
        """
        built = {"algorithm": self.algorithm, **self.module_settings(), "gru": self.gru}
        return {name: value for name, value in built.items() if name not in self.interchangeable}

    def carried(self, block: AgentBlock) -> dict[str, Box]:
        """Return the leaves that the sampler adds to the observations of a block's agents."""
        return {MEMORY: Box(-1.0, 1.0, (self.gru,), np.float32)} if self.gru else {}

    def adapt(self, env: VectorJointEnv) -> VectorJointEnv:
        """Return the environment as this algorithm's agents see it."""
        return env

    def fitting(self, env: VectorJointEnv, spec: JointSpec) -> VectorJointEnv:
        """Return the environment as this algorithm's agents see it, if they are those of `spec`.

        Raises:
            SpaceError: It has other agents or spaces.
        """
        adapted = self.adapt(env)
        check_spaces(self.spec_of(adapted), spec, place=name_of(env))
        return adapted

    def spec_of(self, adapted: VectorJointEnv) -> JointSpec:
        """Return agents and groups of an environment as this algorithm's agents see it."""
        return JointSpec.build(adapted.spaces, self.sharing, self.carried, self.set_width, self.identity)

    def exploration(self, steps: int) -> Exploration:  # type: ignore[override] - RLlib's is of its old stack
        """Return how runners explore after this many environment steps."""
        exploration, name = Exploration(explore=bool(self.explore)), self.explores_by
        if not name:
            return exploration
        extent = getattr(self, name)
        if isinstance(extent, Sequence):
            first, last = extent
            extent = annealed((first, last), getattr(self, f"{name}_steps"), steps)
        return exploration._replace(**{name: extent})

    def policy_spec(
        self, spec: JointSpec, group: Group, module: type[JointModule] = JointModule
    ) -> RLModuleSpec:
        """Describe a policy network of a group."""
        return self._module_spec(spec, module, group, exploration=self.exploration(ALL_STEPS))

    def learner_spec(
        self, spec: JointSpec, module: type[LearnerModule], group: Group | None = None
    ) -> RLModuleSpec:
        """Describe a network that only learners hold, of one group or of all agents."""
        described = self._module_spec(spec, module, group)
        described.learner_only = True
        return described

    def _module_spec(self, spec: JointSpec, module: Any, group: Group | None, **more: Any) -> RLModuleSpec:
        observation, action = agent_spaces(group or spec.groups[0])
        built = {"spec": spec, "group": group.id if group else None, "settings": self.module_settings()}
        return RLModuleSpec(
            module_class=module, observation_space=observation, action_space=action, model_config=built | more
        )

    def check(self, spec: JointSpec) -> None:
        """Raise if the algorithm cannot handle the environment.

        Raises:
            SpaceError: An action space does not fit, for which the message names algorithms that do, or a
                network would join images.
        """
        for block in spec.spaces.blocks:
            kind = ActionKind.DISCRETE if isinstance(block.action, Discrete) else ActionKind.CONTINUOUS
            if not self.entry.acts_in(kind):
                fitting = ", ".join(name for name, entry in ALGORITHMS.items() if entry.acts_in(kind))
                raise SpaceError(
                    f"{self.algorithm!r} needs {self.entry.actions} actions, "
                    f"but {block.agents[0]!r} has {block.action}",
                    place="action space",
                    remedy=f"for {kind} actions use one of: {fitting}",
                )
        networks = filter(None, (self.policy_module, self.critic_module, *self.team_modules.values()))
        joined = {network.joins for network in networks}
        if "observations" in joined or ("state" in joined and not spec.spaces.state):
            check_vectors(spec, self.algorithm)

    def get_multi_rl_module_spec(
        self,
        *,
        env=None,
        spaces: Mapping[str, Any] | None = None,
        inference_only: bool = False,
        **kwargs: Any,
    ) -> MultiRLModuleSpec:
        """Return all networks, or those that runners need (RLlib)."""
        spec: JointSpec = spaces[SPEC][0]  # type: ignore[index] - the algorithm has an environment
        self.check(spec)
        modules = self.modules(spec)
        check_policies(self, {group.id for group in spec.groups}, set(modules))
        if inference_only:
            modules = {name: module for name, module in modules.items() if not module.learner_only}
            for module in modules.values():
                module.inference_only = True
        return MultiRLModuleSpec(rl_module_specs=modules)

    def get_default_rl_module_spec(self) -> RLModuleSpec:
        """Return what RLlib takes as the type of networks."""
        return RLModuleSpec(module_class=JointModule)

    def get_default_learner_class(self) -> type:
        """Return the learner (RLlib)."""
        return self.algo_class.learner_class  # type: ignore[union-attr]

    def validate(self) -> None:
        """Check the settings, and draw a seed where none is given (RLlib).

        Raises:
            ValueError: A setting is out of its range or has no effect; settings do not fit each other or the
                machine.
            UnknownSettingError: There is no setting of a name.
        """
        log_once(
            f"{getattr(self.algo_class, '__name__', None)}_on_new_api_stack"
        )  # there is no other stack to warn about
        check_settings(self)
        self._fit_fragment()
        if EPISODE_MEAN not in (self.stats_cls_lookup or {}):  # the user's own beside what runners need
            self.stats_cls_lookup = {**(self.stats_cls_lookup or {}), EPISODE_MEAN: EpisodeMean}
        super().validate()
        self._check_own_settings()
        if self.seed is None:  # drawn once here, so that checkpoints and results hold it
            self.seed = secrets.randbits(31)
            logger.info("seed %d was drawn, since none was given", self.seed)

    def trains(self, policy: str) -> bool:
        """Return whether RLlib's `policies_to_train` has the policy learn; a frozen one only acts."""
        chosen: Any = self.policies_to_train
        if chosen is None:
            return True
        return bool(chosen(policy, None)) if callable(chosen) else policy in chosen

    def _fit_fragment(self) -> None:
        """Set the rollout's length to what RLlib's `train_batch_size_per_learner` asks for."""
        size = self._train_batch_size_per_learner
        if size is None or self.in_evaluation:
            return
        count = int(self.num_envs_per_env_runner or 1) * max(self.num_env_runners or 0, 1)
        default = self.entry.settings.model_fields["rollout_fragment_length"].default
        if size % count or self.rollout_fragment_length not in ("auto", default, size // count):
            self._value_error(
                f"train_batch_size_per_learner={size} is not rollout_fragment_length="
                f"{self.rollout_fragment_length} times the {count} environments: leave one of them out"
            )
        if self.rollout_fragment_length != size // count:
            self.rollout_fragment_length = size // count

    def _check_own_settings(self) -> None:
        values = {name: getattr(self, name) for name in self.setting_names}
        if self.in_evaluation:  # RLlib's copy for evaluation has fragments of one step
            values["rollout_fragment_length"] = values["sequence_length"]
        for fault in faults(self.entry.settings, values):
            self._value_error(str(fault))
        if self.gru and not self.entry.recurrent:
            fitting = ", ".join(name for name, entry in ALGORITHMS.items() if entry.recurrent)
            self._value_error(f"gru={self.gru}: {self.algorithm!r} has no memory; use one of: {fitting}")

    def _validate_multi_agent_settings(self) -> None:
        """Leave the names of policies to `check_policies`, which knows the environment (RLlib)."""


def _unused_mapping(agent_id: str, episode: Any = None, **kwargs: Any) -> str:
    return "shared"
