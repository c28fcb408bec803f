"""RLlib's own settings that joint algorithms do not honour, and what to use instead of each."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from typing import Any

from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.callbacks.callbacks import RLlibCallback

_CONNECTOR = "there are no connectors: wrap the environment, or override `adapt` of the config"
_OLD = "it belongs to RLlib's old API stack: leave it out"
_SPACES = "the environment's own spaces count: leave it out"
_SYNCHRONOUS = "requests are synchronous and weights travel with each: leave it out"
_RECORDED = "joint algorithms learn from environments only: leave it out"
_COMPILED = "networks are stacked, not compiled: leave it out"
_COUNTED = "an iteration is one rollout: use `rollout_fragment_length`, or `stop` of Tune"
_HOOK = "it is never called: use `on_episode_start`, `on_episode_step` or `on_episode_end`"
_AUTO = "evaluations are a number of episodes: use `evaluation_duration`"
_CHECKPOINT = "checkpoints hold all networks: use `algo.get_module(name)` for one of them"
_VARIABLES = "use `ray.init(runtime_env={'env_vars': {...}})`"

REFUSED: dict[str, str] = {
    "extra_python_environs_for_driver": _VARIABLES,
    "extra_python_environs_for_worker": _VARIABLES,
    "num_gpus": "use `learners(num_gpus_per_learner=...)`",
    "_fake_gpus": _OLD,
    "framework": "networks are PyTorch's: leave it out",
    "eager_tracing": _OLD,
    "eager_max_retraces": _OLD,
    "tf_session_args": _OLD,
    "local_tf_session_args": _OLD,
    "torch_compile_learner": _COMPILED,
    "torch_compile_learner_what_to_compile": _COMPILED,
    "torch_compile_learner_dynamo_mode": _COMPILED,
    "torch_compile_learner_dynamo_backend": _COMPILED,
    "torch_compile_worker": _COMPILED,
    "torch_compile_worker_dynamo_backend": _COMPILED,
    "torch_compile_worker_dynamo_mode": _COMPILED,
    "torch_ddp_kwargs": "learners average gradients themselves: leave it out",
    "torch_skip_nan_gradients": "environments that give NaN are replaced: use `max_env_failures`",
    "enable_rl_module_and_learner": "joint algorithms exist on the new API stack only: leave it out",
    "enable_env_runner_and_connector_v2": "joint algorithms exist on the new API stack only: leave it out",
    "observation_space": _SPACES,
    "action_space": _SPACES,
    "render_env": _OLD,
    "clip_rewards": "clip in the environment, or use `training(reward_scale=...)`",
    "normalize_actions": "policies act in [-1, 1], scaled to the bounds of the action space: leave it out",
    "clip_actions": "actions are always clipped to the bounds of the action space: leave it out",
    "disable_env_checking": "use `algorithms.joint.conformance.check_vector_env`",
    "is_atari": _OLD,
    "action_mask_key": "name the mask 'action_mask' in the environment's observation",
    "create_local_env_runner": "the local runner tells the spaces: leave it out",
    "create_env_on_local_worker": "the local runner samples where `num_env_runners` is 0",
    "gym_env_vectorize_mode": "use `num_env_runners` for processes, or a vector environment",
    "max_requests_in_flight_per_env_runner": _SYNCHRONOUS,
    "env_to_module_connector": _CONNECTOR,
    "module_to_env_connector": _CONNECTOR,
    "add_default_connectors_to_env_to_module_pipeline": _CONNECTOR,
    "add_default_connectors_to_module_to_env_pipeline": _CONNECTOR,
    "episode_lookback_horizon": "stack observations in the environment, or use `training(gru=...)`",
    "merge_env_runner_states": _SYNCHRONOUS,
    "broadcast_env_runner_states": _SYNCHRONOUS,
    "use_env_runner_state_server": _SYNCHRONOUS,
    "env_runner_state_server_max_concurrency": _SYNCHRONOUS,
    "compress_observations": "rollouts are arrays in shared memory: leave it out",
    "batch_mode": "rollouts end within episodes, which are bootstrapped; 'pg' learns from whole ones",
    "episodes_to_numpy": "rollouts are arrays: leave it out",
    "use_worker_filter_stats": _OLD,
    "update_worker_filter_stats": _OLD,
    "exploration_config": "use the algorithm's own settings, such as `training(epsilon=...)`",
    "sample_collector": _OLD,
    "remote_worker_envs": _OLD,
    "remote_env_batch_wait_ms": _OLD,
    "preprocessor_pref": _OLD,
    "observation_filter": "scale observations in the environment",
    "enable_tf1_exec_eagerly": _OLD,
    "sampler_perf_stats_ema_coef": _OLD,
    "num_aggregator_actors_per_learner": _SYNCHRONOUS,
    "max_requests_in_flight_per_aggregator_actor": _SYNCHRONOUS,
    "max_requests_in_flight_per_learner": _SYNCHRONOUS,
    "learner_connector": "override `prepare` of the learner, and give it to `learners(learner_class=...)`",
    "add_default_connectors_to_learner_pipeline": "override `prepare` of the learner",
    "train_batch_size": "use `train_batch_size_per_learner`, or `rollout_fragment_length`",
    "num_epochs": "replay has no epochs: use `training(updates_per_step=...)`",
    "minibatch_size": "use `training(batch_size=...)`",
    "shuffle_batch_per_epoch": "minibatches are always shuffled: leave it out",
    "model": "use `training(hidden=..., gru=...)`",
    "optimizer": "networks have Adam: use `training(lr=...)`",
    "evaluation_auto_duration_min_env_steps_per_sample": _AUTO,
    "evaluation_auto_duration_max_env_steps_per_sample": _AUTO,
    "off_policy_estimation_methods": _RECORDED,
    "ope_split_batch_by_episode": _RECORDED,
    "policy_map_capacity": _OLD,
    "policy_states_are_swappable": _OLD,
    "policy_mapping_fn": "give it to `multi_agent(policy_mapping_fn=...)`, or use `training(sharing=...)`",
    "observation_fn": "wrap the environment",
    "count_steps_by": "settings count steps of environments: leave it out",
    "keep_per_episode_custom_metrics": "use the callback `on_episode_end`",
    "metrics_episode_collection_timeout_s": "use `env_runners(sample_timeout_s=...)`",
    "min_time_s_per_iteration": _COUNTED,
    "min_train_timesteps_per_iteration": _COUNTED,
    "min_sample_timesteps_per_iteration": _COUNTED,
    "log_gradients": "`gradient_norm` is always among the learner's results: leave it out",
    "export_native_model_files": _CHECKPOINT,
    "checkpoint_trainable_policies_only": _CHECKPOINT,
    "fake_sampler": _OLD,
    "restart_failed_sub_environments": "they always are: use `training(max_env_failures=...)`",
    "num_consecutive_env_runner_failures_tolerance": "use `training(max_silent_iterations=...)`",
    "model_config": "give it to `rl_module(model_config=...)`, or use `training(hidden=..., gru=...)`",
    "rl_module_spec": "override `modules` of the config, see docs/algorithms_inside.md",
    "on_environment_created": _HOOK,
    "on_episode_created": _HOOK,
    "on_sample_end": _HOOK,
    "_tf_policy_handles_more_than_one_loss": _OLD,
    "_disable_preprocessor_api": _OLD,
    "_disable_action_flattening": _OLD,
    "_disable_initialize_loss_from_dummy_batch": _OLD,
    "_torch_grad_scaler_class": "networks are float32: leave it out",
    "_torch_lr_scheduler_classes": "use a schedule: `training(lr=[[0, 0.001], [10000, 0.0001]])`",
}
"""Keywords of `AlgorithmConfig`'s methods that would be ignored, and the remedy."""

REFUSED |= {
    name: _RECORDED
    for method in (AlgorithmConfig.offline_data, AlgorithmConfig.evaluation, AlgorithmConfig.callbacks)
    for name in inspect.signature(method).parameters
    if name != "self" and (method is AlgorithmConfig.offline_data or "offline" in name)
}

_ATTRIBUTES = {
    "framework": "framework_str",
    "custom_stats_cls_lookup": "stats_cls_lookup",
    "dataset_num_iters_per_offline_eval_runner": "dataset_num_iters_per_eval_runner",
}
_HOOKS = [name for name in REFUSED if name.startswith("on_")]
_BY_RLLIB = {"batch_mode"}
"""What RLlib changes itself in its copy of a config for evaluation."""


def attribute_of(config: AlgorithmConfig, keyword: str) -> str:
    """Return the attribute of a config in which RLlib keeps a keyword's value."""
    if keyword in _ATTRIBUTES:
        return _ATTRIBUTES[keyword]
    if keyword.startswith("on_"):
        return f"callbacks_{keyword}"
    return f"_{keyword}" if f"_{keyword}" in vars(config) else keyword


def ignored_settings(config: Any, default: Any) -> Iterator[str]:
    """Yield what is wrong with settings that differ from the default and would change nothing."""
    own = {*config.setting_names, *(_BY_RLLIB if config.in_evaluation else ())}
    for name in REFUSED.keys() - own:
        attribute = attribute_of(default, name)
        value = vars(config).get(attribute)
        if _differ(value, vars(default).get(attribute)):
            yield f"{name}={value!r} is not a setting of {config.algorithm!r}: {REFUSED[name]}"
    for hooks in _listed(config.callbacks_class):
        for name in _HOOKS:
            if getattr(hooks, name, None) is not getattr(RLlibCallback, name):
                yield f"{name} of callbacks_class={hooks.__name__}: {REFUSED[name]}"


def _differ(one: Any, other: Any) -> bool:
    return one is not other and bool(one != other)


def _listed(value: Any) -> Iterable[Any]:
    return value if isinstance(value, list | tuple) else [value]
