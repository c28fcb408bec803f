"""Checks of RLlib's settings of environment runners and of evaluation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from algorithms.joint.rllib_names import check_attributes, same_value

READ_IN_EVALUATION = frozenset(
    {
        "explore",
        "env",
        "env_config",
        "num_envs_per_env_runner",
        "num_cpus_per_env_runner",
        "num_gpus_per_env_runner",
        "custom_resources_per_env_runner",
        "max_env_failures",
        "torch_threads",
        "evaluate_sampled",
        "seed",
        "log_level",
    }
)
"""Settings that may be others in evaluation; those of how an algorithm explores come to these."""


def sampling_faults(config: Any) -> Iterator[str]:
    """Yield what is wrong with a config's settings of environment runners and of results."""
    for name in ("num_envs_per_env_runner", "metrics_num_episodes_for_smoothing"):
        value = getattr(config, name)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            yield f"{name}={value!r} is not a whole number from 1 on"
    limit = config.sample_timeout_s
    if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int | float) or not limit > 0):
        yield f"sample_timeout_s={limit!r} is not a number above 0, nor None"


def evaluation_faults(config: Any) -> Iterator[str]:
    """Yield what is wrong with a config's settings of evaluation.

    Raises:
        UnknownSettingError: `evaluation_config` has a name that the config has not.
    """
    if config.in_evaluation:
        return
    if config.evaluation_duration == "auto":
        yield "evaluation_duration must be a number of episodes: scores would not be comparable"
    if config.evaluation_duration_unit != "episodes":
        yield "evaluation_duration_unit must be 'episodes': parts of episodes have no return"
    changed: Mapping[str, Any] = config.evaluation_config or {}  # RLlib makes a dict of a config
    check_attributes(config, changed, "evaluation(evaluation_config=...)")
    read = READ_IN_EVALUATION | config.exploration_settings
    for given, value in changed.items():
        name = config._translate_special_keys(given, warn_deprecated=False)
        if name not in read and not name.startswith("_") and not same_value(getattr(config, name), value):
            yield (
                f"evaluation(evaluation_config=...): {name}={value!r} would change nothing: the networks are "
                f"those of the training, and evaluation reads {', '.join(sorted(read))} alone"
            )
    if config.evaluate_sampled and changed.get("explore", config.explore):
        yield "evaluate_sampled=True beside explore=True: evaluations are sampled already, leave one out"
