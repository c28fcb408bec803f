"""RLlib's own settings: those that joint algorithms read, and those that are other names of ours."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.policy.policy import PolicySpec

from algorithms.errors import SpaceError, UnknownSettingError, nearest_names
from algorithms.setting_kinds import faults
from algorithms.settings import Count, NotNegative, Number, Positive

_HONOURED = """
    num_cpus_for_main_process custom_resources_for_main_process placement_strategy local_gpu_idx
    env env_config env_runner_cls num_env_runners num_envs_per_env_runner num_cpus_per_env_runner
    num_gpus_per_env_runner custom_resources_per_env_runner validate_env_runners_after_construction
    sample_timeout_s explore
    num_learners num_cpus_per_learner num_gpus_per_learner custom_resources_per_learner _learner_class
    learner_config_dict grad_clip_by _train_batch_size_per_learner
    callbacks_class callbacks_on_algorithm_init callbacks_on_train_result callbacks_on_evaluate_start
    callbacks_on_evaluate_end callbacks_on_env_runners_recreated callbacks_on_checkpoint_loaded
    callbacks_on_episode_start callbacks_on_episode_step callbacks_on_episode_end
    evaluation_interval evaluation_duration evaluation_duration_unit evaluation_sample_timeout_s
    evaluation_parallel_to_training evaluation_unhealthy_workers_timeout_s
    evaluation_error_after_n_consecutive_skips evaluation_force_reset_envs_before_iteration evaluation_config
    evaluation_num_env_runners custom_evaluation_function
    policies policies_to_train policy_mapping_fn
    metrics_num_episodes_for_smoothing stats_cls_lookup log_level log_sys_usage seed
    restart_failed_env_runners ignore_env_runner_failures max_num_env_runner_restarts
    delay_between_env_runner_restarts_s env_runner_health_probe_timeout_s env_runner_restore_timeout_s
    algorithm_config_overrides_per_module _per_module_overrides
    _validate_config _use_msgpack_checkpoints
    algo_class in_evaluation _is_frozen _is_online _prior_exploration_config simple_optimizer
"""
HONOURED = frozenset(_HONOURED.split())
"""RLlib's settings that have an effect, and what its configs note for themselves, as attributes."""
OTHER_NAMES = {"num_epochs": "epochs", "num_sgd_iter": "epochs", "train_batch_size_per_learner": "batch_size"}
"""Our names of RLlib's settings that mean the same, in algorithms that have ours."""
USUAL_NAMES = {
    "learning_rate": "lr",
    "vf_loss_coeff": "value_coeff",
    "clip_param": "clip",
    "lambda": "lambda_",
    "gae_lambda": "lambda_",
    "discount": "gamma",
    "ent_coef": "entropy_coeff",
    "buffer_size": "capacity",
}
"""Our names of settings by what they are called elsewhere."""
_READ_IN_EVALUATION = """
    explore env env_config num_envs_per_env_runner num_cpus_per_env_runner num_gpus_per_env_runner
    custom_resources_per_env_runner max_env_failures torch_threads evaluate_sampled seed log_level
"""
READ_IN_EVALUATION = frozenset(_READ_IN_EVALUATION.split())
"""Settings that may be others in evaluation; those of how an algorithm explores come to these."""
DEFAULT_POLICIES = {"shared"}
"""Names of policies where the user gives none; they are never asked for."""


class _Values(BaseModel):
    """Types and ranges of RLlib's settings that RLlib does not check."""

    model_config = ConfigDict(strict=True)
    num_env_runners: Number
    num_envs_per_env_runner: Count
    num_learners: Number
    num_gpus_per_learner: NotNegative
    sample_timeout_s: Positive | None
    metrics_num_episodes_for_smoothing: Count
    evaluation_duration: Count
    evaluation_duration_unit: Literal["episodes"]
    seed: Annotated[int, Field(ge=0, lt=2**32)] | None


@dataclass(frozen=True)
class MappedPolicies:
    """`sharing` as RLlib's `policy_mapping_fn` says: a function from agent to group.

    Args:
        mapping: RLlib's function of agent and episode.
    """

    mapping: Callable[..., str]

    def __call__(self, agent: str) -> str:
        """Return the agent's policy."""
        return self.mapping(agent, None)


def check_known(config: Any, names: Iterable[str], known: Collection[str], place: str) -> None:
    """Raise if there is no setting of a name.

    Args:
        config: The config whose settings they are.
        names: The names.
        known: All names that there are.
        place: Where they were given.

    Raises:
        UnknownSettingError: It offers the name of ours, or the nearest ones.
    """
    for name in sorted({*names} - {*known}):
        close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        raise UnknownSettingError(
            f"{config.algorithm!r} has no setting {name!r}",
            place=place,
            remedy=f"use {USUAL_NAMES[name]!r}"
            if USUAL_NAMES.get(name) in known
            else nearest_names(name, known if close else config.setting_names),
        )


def check_settings(config: Any) -> None:
    """Raise if settings of RLlib's are unknown, have no effect, are out of range or do not fit.

    Raises:
        UnknownSettingError: There is no setting of a name.
        ValueError: A value is wrong.
    """
    fresh = vars(type(config)(config.algo_class))
    public = [name for name in fresh if not name.startswith("_")]
    known = {*fresh, *dir(type(config)), "class"}  # which RLlib's `from_state` leaves behind
    given = {name for name in vars(config) if name not in known and not name.startswith("_")}
    check_known(config, given, public, "config")
    for name in (*config.setting_names, *_Values.model_fields):
        if isinstance(value := getattr(config, name), np.generic):  # which RLlib's schedules do not take
            setattr(config, name, value.item())
    values = {name: getattr(config, name) for name in _Values.model_fields}
    found = (_without_effect(config, fresh), faults(_Values, values), _evaluation_faults(config, fresh))
    for each in chain(*found, _policy_faults(config), _learner_faults(config)):
        config._value_error(str(each))


def _without_effect(config: Any, fresh: dict[str, Any]) -> Iterator[str]:
    """Yield settings that differ from the default, but have no effect."""
    read = HONOURED | {*config.setting_names, *(("batch_mode",) if config.in_evaluation else ())}
    for name in sorted(vars(AlgorithmConfig()).keys() - read):
        value, default = vars(config).get(name), fresh.get(name)
        if value is not default and value != default:
            shown = f"{name.lstrip('_')}={reprlib.repr(value)}"
            own = f"the algorithm's own are listed by `smarts-bench settings {config.algorithm}`"
            yield f"{shown} has no effect on {config.algorithm!r}: leave it out; {own}"


def _evaluation_faults(config: Any, fresh: dict[str, Any]) -> Iterator[str]:
    """Yield settings of `evaluation_config` that evaluation does not read."""
    readable = fresh.keys() & {*READ_IN_EVALUATION, config.explores_by, f"{config.explores_by}_steps"}
    for given, value in (config.evaluation_config or {}).items():
        name = config._translate_special_keys(given, warn_deprecated=False)
        check_known(config, [name], fresh, "evaluation(evaluation_config=...)")
        if name not in readable and not name.startswith("_") and value != getattr(config, name):
            yield (
                f"evaluation_config: {name}={value!r} has no effect: evaluation plays with the trained "
                f"networks, and reads {', '.join(sorted(readable))}"
            )


def _policy_faults(config: Any) -> Iterator[str]:
    """Yield settings that single policies or networks do not have."""
    for name, spec in config.policies.items() if isinstance(config.policies, dict) else ():
        if isinstance(spec, PolicySpec) and any(vars(spec).values()):
            yield f"policies[{name!r}] has settings of its own: use training(), for all policies"
    for module_id, changes in config.algorithm_config_overrides_per_module.items():
        for name in changes.keys() - {"lr"}:
            yield (
                f"algorithm_config_overrides_per_module of {module_id!r}: {name!r} has no effect, networks "
                "have learning rates of their own only, 'lr'"
            )


def _learner_faults(config: Any) -> Iterator[str]:
    """Yield what learners lack on their machines."""
    gpus, learners = config.num_gpus_per_learner, config.num_learners
    if learners > 1 and 0 < gpus < 1:
        yield (
            f"num_gpus_per_learner={gpus}: {learners} learners average gradients by NCCL, which needs one "
            "GPU per learner: set it to 1, or num_learners to 1"
        )
    if gpus and not learners and not torch.cuda.is_available():
        yield (
            f"num_gpus_per_learner={gpus}: torch finds no GPU on this machine, on which num_learners=0 "
            "learns; set it to 0, or num_learners to 1 for another machine's"
        )


def network_settings(model_config: Any) -> dict[str, Any]:
    """Return the settings of ours that a model config, a dict or RLlib's dataclass, asks for.

    Raises:
        UnknownSettingError: It asks for something that networks do not have.
    """
    given = model_config
    if isinstance(model_config, DefaultModelConfig):
        unset = asdict(DefaultModelConfig())
        given = {name: value for name, value in asdict(model_config).items() if value != unset[name]}
    for name in given.keys() - {"fcnet_hiddens", "hidden", "gru"}:
        raise UnknownSettingError(
            f"networks have no setting {name!r}",
            place="rl_module(model_config=...)",
            remedy="use 'fcnet_hiddens', 'hidden' or 'gru'; own networks: docs/develop/algorithms_inside.md",
        )
    return {{"fcnet_hiddens": "hidden"}.get(name, name): value for name, value in given.items()}


def check_policies(config: Any, groups: set[str], modules: set[str]) -> None:
    """Raise if settings name policies or networks that do not exist.

    Args:
        config: The config.
        groups: Names of the policies.
        modules: Names of all networks.

    Raises:
        SpaceError: They do.
    """
    named = set(config.policies) if set(config.policies) != DEFAULT_POLICIES else groups
    chosen: Any = config.policies_to_train or ()
    for place, unknown, known in (
        ("multi_agent(policies=...)", named ^ groups, groups),
        ("multi_agent(policies_to_train=...)", set(() if callable(chosen) else chosen) - groups, groups),
        (
            "rl_module(algorithm_config_overrides_per_module=...)",
            set(config.algorithm_config_overrides_per_module) - modules,
            modules,
        ),
    ):
        if unknown:
            raise SpaceError(
                f"{sorted(unknown)} is missing or too much: there are {sorted(known)}",
                place=place,
                remedy="name the policies that `training(sharing=...)` or the mapping makes",
            )
