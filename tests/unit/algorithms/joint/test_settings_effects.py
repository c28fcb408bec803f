"""Settings of RLlib that a run honours: another value changes what the run gives, holds or asks for."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from test_rllib_settings import HONOURED, PUBLIC

import algorithms
from algorithms.joint.runner import JointEnvRunner
from algorithms.ppo import PPO, PPOLearner
from tests.games.games import Cues


class Timed(Cues):
    """Cues of as many steps as its config says."""

    def __init__(self, config=None):
        super().__init__(config)
        self.length = int((config or {}).get("length", 8))


class Longer(Timed):
    """One of twice the length."""

    def __init__(self, config=None):
        super().__init__(config)
        self.length *= 2


class Told(PPOLearner):
    """Learns from rewards of which its config says the scale."""

    def prepare(self, rollout):
        scale = self.config.learner_config_dict.get("scale", 0.5)
        return super().prepare(replace(rollout, rewards=rollout.rewards * scale))


class Noting(RLlibCallback):
    """Adds a number to each result."""

    def on_train_result(self, *, result, **kwargs):
        result["noted"] = 7


OTHER: dict[str, Any] = {
    "env": Longer,
    "env_config": {"length": 5},
    "env_runner_cls": type("Own", (JointEnvRunner,), {}),
    "num_envs_per_env_runner": 3,
    "rollout_fragment_length": 32,
    "gamma": 0.5,
    "lr": 1e-2,
    "grad_clip": 1e-3,
    "grad_clip_by": "value",
    "train_batch_size_per_learner": 64,
    "num_epochs": 1,
    "minibatch_size": 8,
    "callbacks_class": Noting,
    "learner_class": Told,
    "learner_config_dict": {"scale": 2.0},
    "evaluation_interval": 2,
    "evaluation_duration": 5,
    "evaluation_config": {"explore": True},
    "policies_to_train": ["agent_0"],
    "metrics_num_episodes_for_smoothing": 2,
    "seed": 4,
    "algorithm_config_overrides_per_module": {"agent_0": {"lr": 1e-2}},
    "custom_evaluation_function": lambda algo, group: ({"env_runners": {"own": 1.0}}, 1, 1),
}
"""Values that change the numbers of a run in one process, or what is in its results."""
BESIDE: dict[str, dict[str, Any]] = {
    "grad_clip_by": {"grad_clip": 0.1},
    "train_batch_size_per_learner": {
        "train_batch_size_per_learner": 32,
        "rollout_fragment_length": "auto",
    },
    "learner_config_dict": {"learner_class": Told},
}
"""What both runs need."""
ASKED_FOR: dict[str, tuple[Any, dict[str, Any]]] = {
    "num_cpus_for_main_process": (2, {}),
    "custom_resources_for_main_process": ({"disk": 1}, {}),
    "placement_strategy": ("SPREAD", {}),
    "num_env_runners": (2, {}),
    "num_cpus_per_env_runner": (0.5, {"num_env_runners": 1}),
    "num_gpus_per_env_runner": (0.25, {"num_env_runners": 1}),
    "custom_resources_per_env_runner": ({"disk": 1}, {"num_env_runners": 1}),
    "num_learners": (1, {}),
    "num_cpus_per_learner": (0.5, {"num_learners": 1}),
    "num_gpus_per_learner": (0.25, {"num_learners": 1}),
    "custom_resources_per_learner": ({"disk": 1}, {"num_learners": 1}),
    "evaluation_num_env_runners": (1, {"evaluation_interval": 1}),
}
"""Values that change what a trial of Tune asks for, and what both configs need."""
HOOKS = [
    "on_algorithm_init",
    "on_train_result",
    "on_evaluate_start",
    "on_evaluate_end",
    "on_checkpoint_loaded",
    "on_episode_start",
    "on_episode_step",
    "on_episode_end",
]
"""Functions that are called."""
ELSEWHERE = {
    "explore": "tests/unit/algorithms/joint/test_rllib_contract.py",
    "max_num_env_runner_restarts": "tests/unit/algorithms/joint/test_rllib_contract.py",
    "on_env_runners_recreated": "tests/unit/algorithms/joint/test_rllib_contract.py",
    "policies": "tests/unit/algorithms/joint/test_rllib_settings.py",
    "sample_timeout_s": "tests/unit/algorithms/joint/test_rllib_contract.py",
}
"""Files whose tests show the effect of others."""
ONLY_READ = {
    *(
        "_use_msgpack_checkpoints",
        "_validate_config",
        "custom_stats_cls_lookup",
        "local_gpu_idx",
        "log_level",
    ),
    *("delay_between_env_runner_restarts_s", "env_runner_health_probe_timeout_s", "log_sys_usage"),
    *("env_runner_restore_timeout_s", "evaluation_duration_unit", "evaluation_parallel_to_training"),
    *("evaluation_error_after_n_consecutive_skips", "evaluation_force_reset_envs_before_iteration"),
    *("evaluation_sample_timeout_s", "evaluation_unhealthy_workers_timeout_s", "ignore_env_runner_failures"),
    *("restart_failed_env_runners", "validate_env_runners_after_construction"),
}
"""Limits of time, what is logged, and choices between ways to the same: a run reads them."""
METHOD = {name: method for method, name in PUBLIC}


def given(changes, **rest):
    """Return a small config with values of settings by their names."""
    config: AlgorithmConfig = algorithms.config("ppo").environment(Timed).debugging(seed=3)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=16)
    config.training(hidden=(16,), minibatch_size=16, epochs=2)
    config.evaluation(evaluation_interval=1, evaluation_duration=2)
    for name, value in {**rest, **changes}.items():
        getattr(config, METHOD[name])(**{name: value})
    return config


def outcome(config) -> dict[str, Any]:
    """Return the numbers of three iterations that do not depend on the machine."""
    algo = config.build_algo()
    try:
        results = [algo.train() for _ in range(3)]
        runner = type(algo.env_runner_group.local_env_runner)
        state = algo.learner_group.get_state()["learner"]["rl_module"]
    finally:
        algo.stop()
    names = ("num_env_steps_sampled_lifetime", "num_episodes_lifetime", "episode_return_mean", "own")
    found: dict[str, Any] = {"noted": results[-1].get("noted"), "runner": runner}
    for k, result in enumerate(results):
        for part in (result.get("env_runners", {}), result.get("evaluation", {}).get("env_runners", {})):
            found |= {f"{k} {len(found)} {name}": part.get(name) for name in names}
    weights = {f"{m} {name}": np.array(x) for m, part in state.items() for name, x in part.items()}
    return {**found, **{name: x.tobytes() for name, x in weights.items()}}


@pytest.fixture(scope="module")
def usual(cluster):
    """Return what a run of a config gives, each config run once."""
    found: dict[str, dict[str, Any]] = {}

    def of(rest: dict[str, Any]) -> dict[str, Any]:
        key = repr(rest)
        if key not in found:
            found[key] = outcome(given({}, **rest))
        return found[key]

    return of


def test_every_honoured_setting_is_shown_to_change_something_or_named_here():
    shown = {*OTHER, *ASKED_FOR, *HOOKS, *ELSEWHERE}
    assert shown | ONLY_READ == HONOURED.keys()
    assert not shown & ONLY_READ
    for name, file in ELSEWHERE.items():
        assert name in Path(file).read_text()


@pytest.mark.slow
def test_equal_configs_give_equal_runs(usual):
    assert outcome(given({})) == usual({})


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHER)
def test_another_value_gives_another_run(usual, name):
    rest = BESIDE.get(name, {})
    assert outcome(given({name: OTHER[name]}, **rest)) != usual(rest)


@pytest.mark.parametrize("name", ASKED_FOR)
def test_another_value_asks_tune_for_other_resources(name):
    value, rest = ASKED_FOR[name]
    before, after = (PPO.default_resource_request(given(each, **rest)) for each in ({}, {name: value}))
    assert (before.bundles, before.strategy) != (after.bundles, after.strategy)


@pytest.mark.slow
@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize("name", HOOKS)
def test_functions_are_called(name, tmp_path):
    called = []
    algo = given({name: lambda **kwargs: called.append(name)}).build_algo()
    try:
        algo.train()
        algo.save_to_path(str(tmp_path))
        algo.load_checkpoint(str(tmp_path))  # as Tune does
    finally:
        algo.stop()
    assert called
