"""RLlib's own settings: each changes something, or is refused with what to use instead."""

import inspect
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch
from ray import rllib
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.utils.metrics.metrics_logger import DEFAULT_STATS_CLS_LOOKUP
from rigs import takes

import algorithms
from algorithms.errors import SpaceError, UnknownSettingError
from algorithms.joint.config import _plain
from algorithms.joint.rllib_names import same_value
from algorithms.joint.rllib_settings import REFUSED, attribute_of
from algorithms.parts.optimisation import clip_gradients
from algorithms.ppo import PPO, PPOConfig, PPOLearner
from tests.games.games import Cues, Ragged
from tests.games.recall import Recall

METHODS = [
    "python_environment",
    "resources",
    "framework",
    "api_stack",
    "environment",
    "env_runners",
    "learners",
    "training",
    "callbacks",
    "evaluation",
    "offline_data",
    "multi_agent",
    "reporting",
    "checkpointing",
    "debugging",
    "fault_tolerance",
    "rl_module",
    "experimental",
]
PUBLIC = [
    (method, name)
    for method in METHODS
    for name in list(inspect.signature(getattr(AlgorithmConfig, method)).parameters)[1:]
]
HONOURED: dict[str, object] = {
    "num_cpus_for_main_process": 0,
    "custom_resources_for_main_process": {},
    "placement_strategy": "SPREAD",
    "local_gpu_idx": 1,
    "env": Cues,
    "env_config": {"length": 5},
    "env_runner_cls": PPOConfig().env_runner_cls,
    "num_env_runners": 1,
    "num_envs_per_env_runner": 2,
    "num_cpus_per_env_runner": 0.5,
    "num_gpus_per_env_runner": 0,
    "custom_resources_per_env_runner": {},
    "validate_env_runners_after_construction": False,
    "sample_timeout_s": 90.0,
    "rollout_fragment_length": 16,
    "explore": True,
    "num_learners": 0,
    "num_cpus_per_learner": 0,
    "num_gpus_per_learner": 0,
    "custom_resources_per_learner": {},
    "learner_class": PPOLearner,
    "learner_config_dict": {"anything": 1},
    "gamma": 0.9,
    "lr": 1e-3,
    "grad_clip": 1.0,
    "grad_clip_by": "norm",
    "train_batch_size_per_learner": 32,
    "num_epochs": 2,
    "minibatch_size": 16,
    "callbacks_class": RLlibCallback,
    "on_algorithm_init": lambda **kw: None,
    "on_train_result": lambda **kw: None,
    "on_evaluate_start": lambda **kw: None,
    "on_evaluate_end": lambda **kw: None,
    "on_env_runners_recreated": lambda **kw: None,
    "on_checkpoint_loaded": lambda **kw: None,
    "on_episode_start": lambda **kw: None,
    "on_episode_step": lambda **kw: None,
    "on_episode_end": lambda **kw: None,
    "evaluation_interval": 1,
    "evaluation_duration": 2,
    "evaluation_duration_unit": "episodes",
    "evaluation_sample_timeout_s": 90.0,
    "evaluation_parallel_to_training": False,
    "evaluation_unhealthy_workers_timeout_s": 1.0,
    "evaluation_error_after_n_consecutive_skips": 5,
    "evaluation_force_reset_envs_before_iteration": False,
    "evaluation_config": {"explore": True},
    "evaluation_num_env_runners": 1,
    "custom_evaluation_function": None,
    "policies": {"agent_0", "agent_1"},
    "policies_to_train": ["agent_0"],
    "metrics_num_episodes_for_smoothing": 7,
    "custom_stats_cls_lookup": {**DEFAULT_STATS_CLS_LOOKUP},
    "log_level": "ERROR",
    "log_sys_usage": False,
    "seed": 3,
    "restart_failed_env_runners": True,
    "ignore_env_runner_failures": False,
    "max_num_env_runner_restarts": 3,
    "delay_between_env_runner_restarts_s": 0.2,
    "env_runner_health_probe_timeout_s": 20.0,
    "env_runner_restore_timeout_s": 20.0,
    "algorithm_config_overrides_per_module": {"agent_0": {"lr": 1e-2}},
    "_validate_config": True,
    "_use_msgpack_checkpoints": True,
}
"""Values of settings that a run reads; those that become one of ours have tests of their own."""
TRANSLATED = {"policy_mapping_fn", "model_config", "num_epochs", "train_batch_size_per_learner"}
READ_SELDOM = {
    "delay_between_env_runner_restarts_s": "utils/actor_manager.py",
    "evaluation_error_after_n_consecutive_skips": "algorithms/algorithm.py",
    "env_runner_restore_timeout_s": "algorithms/algorithm.py",
    "local_gpu_idx": "utils/framework.py",
    "on_checkpoint_loaded": "algorithms/algorithm.py",
    "on_env_runners_recreated": "algorithms/algorithm.py",
    "_use_msgpack_checkpoints": "algorithms/algorithm.py",
    "_validate_config": "algorithms/algorithm_config.py",
}
"""Files of RLlib that read settings where something fails, or another process does."""

DROPPED = {"enable_connectors"}
"""What RLlib itself drops, with a warning that it is deprecated."""


def probe(name) -> Any:
    """Return a value of a refused setting that is not the default."""
    own = {
        "framework": "tf2",
        "batch_mode": "complete_episodes",
        "preprocessor_pref": "rllib",
        "exploration_config": {"type": "EpsilonGreedy"},
        "count_steps_by": "agent_steps",
        "model": {"fcnet_hiddens": [7]},
        "optimizer": {"lr": 1},
        "input_": "/somewhere",
        "policy_mapping_fn": lambda agent, episode: "shared",
    }
    default = getattr(PPOConfig(), attribute_of(PPOConfig(), name), None)
    if name in own:
        return own[name]
    if isinstance(default, bool):
        return not default
    if isinstance(default, int | float):
        return default + 1
    if isinstance(default, dict):
        return {"something": 1}
    if isinstance(default, list):
        return [*default, "something"]
    return "something"


def small(name="ppo", env: type = Cues, **settings):
    config = algorithms.config(name).environment(env).debugging(seed=3)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=16)
    return config.training(hidden=(16,), **settings)


@pytest.mark.parametrize(("method", "name"), PUBLIC)
def test_every_public_setting_is_honoured_or_refused_by_name(method, name):
    config = small()
    if name in HONOURED or name in TRANSLATED:
        assert name not in REFUSED or name in {*TRANSLATED, "minibatch_size"}
        return
    if name in DROPPED:
        getattr(config, method)(**{name: probe(name)}).validate()
        return
    # RLlib itself refuses, by the new name, what it has renamed.
    match = name if name in REFUSED else None
    with pytest.raises((ValueError, TypeError), match=match):
        getattr(config, method)(**{name: probe(name)}).validate()


@pytest.mark.parametrize("name", ["num_epochs", "minibatch_size"])
def test_settings_of_rollouts_are_refused_where_there_is_replay(name):
    settings: dict[str, Any] = {name: 3}
    with pytest.raises(ValueError, match=rf"{name}=3.*'dqn'"):
        small("dqn", **settings).validate()


@pytest.fixture
def read(monkeypatch):
    """The settings that this process reads, but for checks and RLlib's own setters."""
    found = set()

    def get(config, name):
        reader = sys._getframe(1).f_code.co_name
        if "validate" not in reader and reader not in {*METHODS, "_check_settings"}:
            found.add(name)
        return object.__getattribute__(config, name)

    monkeypatch.setattr(PPOConfig, "__getattribute__", get)
    return found


@pytest.fixture
def build():
    built = []

    def built_algo(config):
        built.append(config.build_algo())
        return built[-1]

    yield built_algo
    for algo in built:
        algo.stop()


@pytest.mark.slow
@pytest.mark.usefixtures("cluster")
def test_every_setting_that_is_not_refused_is_read_by_a_run(build, read, tmp_path):
    for apart in (True, False):
        config = PPOConfig().training(hidden=(16,))
        for method, name in PUBLIC:
            if name in HONOURED:
                getattr(config, method)(**{name: HONOURED[name]})
        if not apart:
            config.env_runners(num_env_runners=0, rollout_fragment_length=16)
            config.evaluation(evaluation_num_env_runners=0)

        algo = build(config)
        algo.train()
        algo.save_to_path(str(tmp_path / str(apart)))
        algo.restore_from_path(str(tmp_path / str(apart)))
    PPO.default_resource_request(PPOConfig().env_runners(num_env_runners=1).learners(num_learners=1))
    unread = {name for name in HONOURED if attribute_of(PPOConfig(), name) not in read}
    for name, file in READ_SELDOM.items():
        assert name in (Path(rllib.__file__).parent / file).read_text()
    assert sorted(unread - READ_SELDOM.keys() - TRANSLATED) == []


def train(algo, iterations=2):
    """Return the last result."""
    result: dict[str, Any] = {}
    for _ in range(iterations):
        result = algo.train()
    return result


def weights(algo):
    state = algo.learner_group.get_state()["learner"]["rl_module"]
    return {module: {name: np.array(x) for name, x in part.items()} for module, part in state.items()}


def moved(before, after):
    """Return the networks whose numbers differ."""
    return {m for m in before if any((before[m][name] != after[m][name]).any() for name in before[m])}


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize("name", [n for n in algorithms.names() if algorithms.entry(n).recurrent])
def test_recurrent_policies_are_built_and_evaluated_by_rllib(build, name):
    """Its config for evaluation has fragments of one step, which are no multiple of a sequence."""
    config = small(name, Recall, gru=8, sequence_length=8)
    algo = build(config.evaluation(evaluation_interval=1, evaluation_duration=3))
    result = train(algo, 1)
    assert result["evaluation"]["env_runners"]["num_episodes"] == 3
    with pytest.raises(ValueError, match="sequence_length"):
        small(name, Recall, gru=8, sequence_length=7).build_algo()


LEARN = {"learning_starts": 32, "batch_size": 16, "capacity": 500}
CLIPPED = ["ppo", "centralised_v", "happo", "recurrent_ippo", "recurrent_mappo", "mat"]
OFF_POLICY = [n for n in algorithms.names() if "capacity" in algorithms.entry(n).settings.model_fields]


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize(
    "name", [n for n in algorithms.names() if n != "networked_q" and takes(n, sharing="none")]
)
def test_policies_that_are_not_to_be_trained_stay_as_they_are(build, name):
    config = small(name, Cues, sharing="none", **(LEARN if name in OFF_POLICY else {}))
    if "normalize_values" in config.setting_names:
        config.training(normalize_values=True)
    algo = build(config.multi_agent(policies_to_train=["agent_1"]))
    before = weights(algo)
    train(algo, 4)
    changed = moved(before, weights(algo))
    assert "agent_1" in changed
    assert not changed & {"agent_0", "agent_0__critic"}


@pytest.mark.parametrize("sharing", ["all", {"pair": ["agent_0", "agent_1"]}])
def test_a_policy_that_is_frozen_and_shared_is_refused_before_anything_is_built(sharing):
    config = small(sharing=sharing).multi_agent(policies_to_train=["agent_0"])
    with pytest.raises(ValueError, match=r"policies_to_train holds 'agent_0'.*sharing="):
        config.validate()
    small(sharing={"pair": ["agent_0", "agent_1"]}).multi_agent(policies_to_train=["pair"]).validate()
    with pytest.raises(ValueError, match=r"policies_to_train=.*'networked_q'"):
        small("networked_q").multi_agent(policies_to_train=["agent_0"]).validate()


@pytest.mark.usefixtures("cluster")
def test_a_policy_mapping_makes_the_groups(build):
    def mapping(agent_id, episode, **kwargs):
        return "odd" if agent_id == "b" else "even"

    config = small("ppo", Ragged).multi_agent(policies={"odd", "even"}, policy_mapping_fn=mapping)
    algo = build(config)
    train(algo, 1)
    groups = {group.id: group.agents for group in algo.spec.groups}
    assert groups == {"odd": ("b",), "even": ("a", "c")}
    assert set(weights(algo)) >= {"odd", "even"}


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize(
    ("settings", "place"),
    [
        ({"policies": {"one"}}, r"policies="),
        ({"policies": {"agent_0", "agent_1", "more"}}, r"policies="),
        ({"policies_to_train": ["agent_7"]}, r"policies_to_train="),
        ({"policies_to_train": []}, r"policies_to_train="),
        ({"policies_to_train": lambda policy, batch: policy == "one"}, r"policies_to_train="),
        ({"policy_mapping_fn": lambda agent, episode: episode.id_}, r"policy_mapping_fn="),
    ],
)
def test_policies_that_there_are_not_are_refused(settings, place):
    with pytest.raises(SpaceError, match=place):
        small().multi_agent(**settings).build_algo()


@pytest.mark.usefixtures("cluster")
def test_epochs_batch_size_and_widths_by_rllibs_names_are_ours(build):
    config = algorithms.config("ppo").environment(Cues).debugging(seed=3)
    config.training(num_epochs=3, train_batch_size_per_learner=64)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=4, rollout_fragment_length="auto")
    named = build(config.rl_module(model_config={"fcnet_hiddens": [5, 6]}))
    ours_config = small(epochs=3).training(hidden=(5, 6)).env_runners(num_envs_per_env_runner=4)
    ours = build(ours_config.env_runners(rollout_fragment_length=16))
    for algo in (named, ours):
        assert train(algo)["env_runners"]["num_env_steps_sampled_lifetime"] == 128
    assert not moved(weights(named), weights(ours))
    assert weights(named)["agent_0"]["body.0.weight"].shape[0] == 5
    assert small("dqn", train_batch_size_per_learner=7).batch_size == 7
    assert PPOConfig().rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[7])).hidden == [7]


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"train_batch_size_per_learner": 33}, "train_batch_size_per_learner=33"),
        ({"train_batch_size_per_learner": 64}, "rollout_fragment_length=16"),
        ({"grad_clip": None, "grad_clip_by": "value"}, "grad_clip_by='value'"),
        ({"learner_config_dict": {"a": 1}}, "learner_config_dict"),
    ],
)
def test_settings_that_do_not_fit_each_other_are_refused(settings, name):
    with pytest.raises(ValueError, match=name):
        small(**settings).validate()


@pytest.mark.parametrize(
    "wrong", [{"use_lstm": True}, {"fcnet_activation": "relu"}, DefaultModelConfig(use_lstm=True)]
)
def test_networks_that_ours_cannot_be_are_refused(wrong):
    with pytest.raises(UnknownSettingError, match=r"model_config"):
        small().rl_module(model_config=wrong)


@pytest.mark.parametrize(
    ("way", "largest"), [("value", "component"), ("norm", "array"), ("global_norm", "all")]
)
def test_gradients_are_clipped_as_asked(way, largest):
    parameters = [torch.nn.Parameter(torch.zeros(3)), torch.nn.Parameter(torch.zeros(2))]
    given = [torch.tensor([3.0, 0.0, 0.001]), torch.tensor([4.0, 0.0])]
    for p, gradient in zip(parameters, given, strict=True):
        p.grad = gradient.clone()
    (norm,) = clip_gradients([parameters], 0.01, way)
    assert norm.item() == pytest.approx(5, rel=1e-5)
    expected = {
        "value": [[0.01, 0, 0.001], [0.01, 0]],
        "norm": [[0.01, 0, 0.001 / 300], [0.01, 0]],
        "global_norm": [[0.006, 0, 0.000002], [0.008, 0]],
    }[way]
    for p, wanted in zip(parameters, expected, strict=True):
        assert p.grad is not None
        torch.testing.assert_close(p.grad, torch.tensor(wanted), rtol=1e-4, atol=1e-7)


@pytest.mark.usefixtures("cluster")
def test_a_networks_own_learning_rate_counts_and_other_overrides_are_refused(build):
    config = small(lr=1e-3).rl_module(algorithm_config_overrides_per_module={"agent_0": {"lr": 0.0}})
    algo = build(config)
    before = weights(algo)
    train(algo, 1)
    changed = moved(before, weights(algo))
    assert "agent_1" in changed
    assert "agent_0" not in changed
    with pytest.raises(ValueError, match="'gamma'"):
        small().rl_module(algorithm_config_overrides_per_module={"agent_0": {"gamma": 0.5}}).validate()


@pytest.mark.parametrize("name", algorithms.names())
@pytest.mark.usefixtures("cluster")
def test_results_hold_what_users_look_for(build, name):
    config = small(name, Cues, **(LEARN if name in OFF_POLICY else {}))
    apart = takes(name, sharing="none")
    results = train(build(config.training(sharing="none" if apart else "all")), 4)["learners"]
    assert results["__all_modules__"]["num_trainable_parameters"] > 100
    policies = ("agent_0", "agent_1") if apart else ("shared",)
    clipped = name in CLIPPED
    wanted = {"gradient_norm"}
    if name not in OFF_POLICY:
        wanted |= {"policy_loss", "entropy", "explained_variance"}
    if clipped:
        wanted |= {"kl", "clip_fraction"}
    if name in ("maac", "maddpg", "mf_ac"):
        wanted |= {"policy_loss"}
    for agent in policies:
        assert wanted <= results[agent].keys()
        assert clipped == ("kl" in results[agent])
        assert all(np.isfinite(results[agent][key]) for key in wanted)
    if clipped:
        assert results[policies[0]]["kl"] >= 0
        assert 0 <= results[policies[0]]["clip_fraction"] <= 1
        assert results[policies[0]]["explained_variance"] <= 1


@pytest.mark.usefixtures("cluster")
def test_smoothed_returns_go_on_where_a_checkpoint_was_made(build, tmp_path):
    algo, other = build(small()), build(small())
    train(algo, 3)
    algo.save_to_path(str(tmp_path))
    expected = train(algo, 1)["env_runners"]
    other.restore_from_path(str(tmp_path))
    found = train(other, 1)["env_runners"]
    for name in ("episode_return_mean", "episode_len_mean", "episode_return_min"):
        assert found[name] == expected[name]


@pytest.mark.usefixtures("cluster")
def test_an_evaluation_of_both_modes_names_both(build):
    algo = build(small(evaluate_sampled=True).evaluation(evaluation_duration=5))
    found = algo.evaluate()["env_runners"]
    assert found["greedy"]["episode_return_mean"] == found["episode_return_mean"]
    assert np.isfinite(found["sampled"]["episode_return_mean"])


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"evaluation_duration_unit": "timesteps"}, "evaluation_duration_unit"),
        ({"evaluation_duration": "auto"}, "evaluation_duration"),
        ({"evaluation_config": {"lr": 1e-9}}, "lr=1e-09"),
        ({"evaluation_config": {"num_learners": 3}}, "num_learners=3"),
        ({"evaluation_config": {"policies_to_train": ["agent_0"]}}, "policies_to_train="),
        ({"evaluation_config": {"hidden": (3,)}}, "hidden="),
        ({"evaluation_config": {"sharing": "all"}}, "sharing='all'"),
        ({"evaluation_config": {"lambda": 0.3}}, "lambda_=0.3"),
    ],
)
def test_what_evaluation_does_not_read_is_refused(change, named):
    """Whether RLlib evaluates by itself, or the user calls `evaluate`."""
    for interval in (None, 1):
        config = small().evaluation(evaluation_interval=interval, **change)
        with pytest.raises(ValueError, match=named.replace("(", r"\(")):
            config.validate()


def test_what_evaluation_reads_may_differ_there():
    small().evaluation(evaluation_config={"lr": small().lr, "env_config": {"length": 3}}).validate()
    config = small("dqn").evaluation(evaluation_config={"explore": True, "epsilon": (0.1, 0.1)})
    config.validate()
    evaluated = config.get_evaluation_config_object()
    assert (evaluated.explore, tuple(evaluated.epsilon)) == (True, (0.1, 0.1))
    assert tuple(config.epsilon) != (0.1, 0.1)


@pytest.mark.parametrize(
    ("method", "given"),
    [
        ("env_runners", {"num_envs_per_env_runner": 2.5}),
        ("env_runners", {"num_envs_per_env_runner": True}),
        ("env_runners", {"sample_timeout_s": -1}),
        ("reporting", {"metrics_num_episodes_for_smoothing": 0}),
    ],
)
def test_numbers_that_make_no_sense_are_refused(method, given):
    ((name, value),) = given.items()
    with pytest.raises(ValueError, match=f"{name}={value}"):
        getattr(small(), method)(**given).validate()


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("ppo", {"lr": np.float32(0.25)}),
        ("ppo", {"entropy_coeff": np.float32(0.5), "minibatch_size": np.int64(16), "hidden": [np.int64(8)]}),
        ("dqn", {"epsilon": (np.float32(1), np.float32(0.5)), "double": np.bool_(False)}),
    ],
)
def test_numbers_of_numpy_are_those_of_python(name, given):
    config = algorithms.config(name).training(**given)
    config.validate()
    for setting, value in given.items():
        found = getattr(config, setting)
        assert same_value(found, value)
        for part in found if isinstance(found, list | tuple) else [found]:
            assert type(part) in (bool, int, float)


def test_an_evaluation_that_is_sampled_already_has_no_second_mode():
    config = small(evaluate_sampled=True).evaluation(evaluation_config={"explore": True})
    with pytest.raises(ValueError, match="evaluate_sampled"):
        config.validate()


@pytest.mark.parametrize(("runners", "window"), [(0, 10), (1, 10), (4, 3)])
def test_returns_are_smoothed_over_as_many_episodes_whatever_the_number_of_runners(runners, window):
    config = small().reporting(metrics_num_episodes_for_smoothing=10)
    runner = config.env_runner_cls(config=config, num_workers=runners, worker_index=min(runners, 1))
    assert runner._recent.maxlen == window
    runner.stop()


@pytest.mark.parametrize("given", [{}, {"hidden": (np.int64(8),)}, {"train_batch_size_per_learner": 64}])
def test_a_frozen_config_that_was_checked_can_be_checked_again(given):
    config = algorithms.config("ppo").training(**given)
    config.validate()
    config.freeze()
    config.validate()


def test_plain_values_are_the_same_objects():
    class Pair(NamedTuple):
        first: Any
        second: Any = 1

    for value in ([1, (2, 3)], (1, "x"), Pair(1), {"a": 1}, None):
        assert _plain(value) is value
    assert repr(_plain([np.int64(1), Pair(np.float32(0.5))])) == "[1, Pair(first=0.5, second=1)]"
