"""RLlib's own settings: those with an effect have it, all others are errors that say what to use instead."""

import numpy as np
import pytest
import torch
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from rigs import cases, takes, train, weights_of

import algorithms
from algorithms.errors import UnknownSettingError
from algorithms.joint.rllib_settings import HONOURED, INSTEAD
from algorithms.parts.optimisation import clip_gradients
from algorithms.ppo import PPO, PPOConfig
from tests.games.games import Cues, Ragged
from tests.games.recall import Recall

LEARN = {"learning_starts": 32, "batch_size": 16, "capacity": 500}
CLIPPED = ["ppo", "centralised_v", "happo", "recurrent_ippo", "recurrent_mappo", "mat"]
OFF_POLICY = [n for n in algorithms.names() if "capacity" in algorithms.entry(n).settings.model_fields]


def small(name="ppo", env: type = Cues, **settings):
    config = algorithms.config(name).environment(env).debugging(seed=3)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=16)
    return config.training(hidden=(16,), **settings)


def moved(before, after):
    """Return the networks whose numbers differ."""
    return {leaf.partition("/")[0] for leaf in before if (before[leaf] != after[leaf]).any()}


def test_the_lists_name_what_rllib_has():
    known = vars(AlgorithmConfig()).keys()
    assert known >= HONOURED
    assert known >= INSTEAD.keys()
    assert not HONOURED & INSTEAD.keys()


class Unheard(RLlibCallback):
    def on_sample_end(self, **kwargs):
        pass


@pytest.mark.parametrize(
    ("name", "method", "given", "named"),
    [
        ("ppo", "training", {"train_batch_size": 4000}, r"train_batch_size=4000.*_per_learner"),
        ("dqn", "training", {"num_epochs": 3}, r"num_epochs=3.*'dqn'.*updates_per_step"),
        ("ppo", "framework", {"framework": "tf2"}, r"framework.*tf2"),
        ("ppo", "env_runners", {"observation_filter": "MeanStdFilter"}, r"observation_filter="),
        ("ppo", "callbacks", {"callbacks_class": Unheard}, r"on_sample_end of .*Unheard"),
    ],
)
def test_a_setting_without_effect_is_an_error(name, method, given, named):
    with pytest.raises(ValueError, match=named):
        getattr(small(name), method)(**given).validate()


@pytest.mark.parametrize(
    ("method", "given"),
    [
        ("env_runners", {"num_env_runners": -1}),
        ("learners", {"num_learners": "2"}),
        ("evaluation", {"evaluation_duration_unit": "timesteps"}),
    ],
)
def test_values_of_a_wrong_type_or_range_are_errors(method, given):
    ((name, value),) = given.items()
    with pytest.raises(ValueError, match=f"{name}={value!r}"):
        getattr(small(), method)(**given).validate()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"lr": 1e-9}, "lr=1e-09"),
        ({"num_learners": 3}, "num_learners=3"),
    ],
)
def test_what_evaluation_does_not_read_is_an_error(change, named):
    config = small().evaluation(evaluation_interval=1, evaluation_config=change)
    with pytest.raises(ValueError, match=named):
        config.validate()


def test_what_evaluation_reads_may_differ_there():
    small().evaluation(evaluation_config={"lr": small().lr, "env_config": {"length": 3}}).validate()
    config = small("dqn").evaluation(evaluation_config={"explore": True, "epsilon": (0.1, 0.1)})
    config.validate()
    evaluated = config.get_evaluation_config_object()
    assert (evaluated.explore, tuple(evaluated.epsilon)) == (True, (0.1, 0.1))
    assert tuple(config.epsilon) != (0.1, 0.1)


@pytest.mark.usefixtures("cluster")
def test_recurrent_policies_are_built_and_evaluated_by_rllib(build):
    """Its config for evaluation has fragments of one step, which are no multiple of a sequence."""
    config = small("ppo", Recall, gru=8, sequence_length=8)
    algo = build(config.evaluation(evaluation_interval=1, evaluation_duration=3))
    result = train(algo, 1)
    assert result["evaluation"]["env_runners"]["num_episodes"] == 3


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize("name", ["ppo", "dqn"])
def test_policies_that_are_not_to_be_trained_stay_as_they_are(build, name):
    config = small(name, Cues, sharing="none", **(LEARN if name in OFF_POLICY else {}))
    if "normalize_values" in config.setting_names:
        config.training(normalize_values=True)
    algo = build(config.multi_agent(policies_to_train=["agent_1"]))
    before = weights_of(algo)
    train(algo, 4)
    changed = moved(before, weights_of(algo))
    assert "agent_1" in changed
    assert not changed & {"agent_0", "agent_0__critic"}


def test_networks_that_average_their_parameters_are_not_frozen():
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
    assert {leaf.partition("/")[0] for leaf in weights_of(algo)} >= {"odd", "even"}


@pytest.mark.usefixtures("cluster")
def test_epochs_batch_size_and_widths_by_rllibs_names_are_ours(build):
    config = algorithms.config("ppo").environment(Cues).debugging(seed=3)
    config.training(num_epochs=3, train_batch_size_per_learner=64)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=4, rollout_fragment_length="auto")
    named = build(config.rl_module(model_config={"fcnet_hiddens": [5, 6]}))
    ours_config = small(epochs=3).training(hidden=(5, 6)).env_runners(num_envs_per_env_runner=4)
    ours = build(ours_config.env_runners(rollout_fragment_length=16))
    for algo in (named, ours):
        assert train(algo, 2)["env_runners"]["num_env_steps_sampled_lifetime"] == 128
    assert not moved(weights_of(named), weights_of(ours))
    assert weights_of(named)["agent_0/body.0.weight"].shape[0] == 5
    assert small("dqn", train_batch_size_per_learner=7).batch_size == 7
    assert PPOConfig().rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[7])).hidden == [7]


def test_a_batch_that_is_no_rollout_is_an_error():
    with pytest.raises(ValueError, match="_per_learner=33"):
        small(train_batch_size_per_learner=33).validate()


def test_networks_that_ours_cannot_be_are_errors():
    with pytest.raises(UnknownSettingError, match=r"model_config"):
        small().rl_module(model_config=DefaultModelConfig(use_lstm=True))


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        ("value", [[0.01, 0, 0.001], [0.01, 0]]),
        ("norm", [[0.01, 0, 0.001 / 300], [0.01, 0]]),
        ("global_norm", [[0.006, 0, 0.000002], [0.008, 0]]),
    ],
)
def test_gradients_are_clipped_as_asked(way, expected):
    parameters = [torch.nn.Parameter(torch.zeros(3)), torch.nn.Parameter(torch.zeros(2))]
    given = [torch.tensor([3.0, 0.0, 0.001]), torch.tensor([4.0, 0.0])]
    for p, gradient in zip(parameters, given, strict=True):
        p.grad = gradient.clone()
    (norm,) = clip_gradients([parameters], 0.01, way)
    assert norm.item() == pytest.approx(5, rel=1e-5)
    for p, wanted in zip(parameters, expected, strict=True):
        assert p.grad is not None
        torch.testing.assert_close(p.grad, torch.tensor(wanted), rtol=1e-4, atol=1e-7)


@pytest.mark.usefixtures("cluster")
def test_a_networks_own_learning_rate_counts_and_other_overrides_are_errors(build):
    config = small(lr=1e-3).rl_module(algorithm_config_overrides_per_module={"agent_0": {"lr": 0.0}})
    algo = build(config)
    before = weights_of(algo)
    train(algo, 1)
    changed = moved(before, weights_of(algo))
    assert "agent_1" in changed
    assert "agent_0" not in changed
    with pytest.raises(ValueError, match="'gamma'"):
        small().rl_module(algorithm_config_overrides_per_module={"agent_0": {"gamma": 0.5}}).validate()


@pytest.mark.parametrize("name", cases(algorithms.names()))
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


def test_numbers_of_numpy_are_those_of_python():
    given = {"lr": np.float32(0.25), "minibatch_size": np.int64(16)}
    config = algorithms.config("ppo").training(**given).debugging(seed=np.int64(5))
    config.validate()
    assert type(config.seed) is int
    for setting, value in given.items():
        assert getattr(config, setting) == value
        assert type(getattr(config, setting)) in (int, float)


@pytest.mark.parametrize(("runners", "window"), [(0, 10), (4, 3)])
def test_returns_are_smoothed_over_as_many_episodes_whatever_the_number_of_runners(runners, window):
    config = small().reporting(metrics_num_episodes_for_smoothing=10)
    runner = config.env_runner_cls(config=config, num_workers=runners, worker_index=min(runners, 1))
    assert runner._recent.maxlen == window
    runner.stop()


@pytest.mark.parametrize(
    ("method", "settings", "beside"),
    [
        ("resources", {"num_cpus_for_main_process": 2}, {}),
        ("env_runners", {"num_env_runners": 2}, {}),
        ("learners", {"num_gpus_per_learner": 0.25}, {"num_learners": 1}),
        ("evaluation", {"evaluation_num_env_runners": 1}, {"evaluation_interval": 1}),
    ],
)
def test_another_value_asks_tune_for_other_resources(method, settings, beside):
    before, after = (
        PPO.default_resource_request(getattr(small(), method)(**given))
        for given in (beside, beside | settings)
    )
    assert before.bundles != after.bundles


HOOKS = {
    *("on_algorithm_init", "on_train_result", "on_evaluate_start", "on_evaluate_end"),
    *("on_checkpoint_loaded", "on_episode_start", "on_episode_step", "on_episode_end"),
}


@pytest.mark.usefixtures("cluster")
def test_callbacks_are_called(build, tmp_path):
    called = set()
    config = small().evaluation(evaluation_interval=1, evaluation_duration=2)
    for name in HOOKS:
        config.callbacks(**{name: lambda name=name, **kwargs: called.add(name)})
    algo = build(config)
    algo.train()
    algo.save_to_path(str(tmp_path))
    algo.load_checkpoint(str(tmp_path))  # as Tune does
    assert called == HOOKS
