"""RLlib's own settings: those with an effect have it, all others are errors."""

import numpy as np
import pytest
import torch
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from rigs import PLAYING, cases, takes, train, weights_of

import algorithms
from algorithms.joint.rllib_settings import HONOURED
from algorithms.parts.optimisation import clip_gradients
from algorithms.ppo import PPOConfig
from tests.games.games import Cues, Ragged
from tests.games.recall import Recall

LEARN = {"learning_starts": 32, "batch_size": 16, "capacity": 500}
CLIPPED = ["ppo", "centralised_v", "happo", "recurrent_ippo", "recurrent_mappo", "mat"]
OFF_POLICY = [n for n in PLAYING if "capacity" in algorithms.entry(n).settings.model_fields]


def small(name="ppo", env: type = Cues, **settings):
    config = algorithms.config(name).environment(env).debugging(seed=3)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=16)
    return config.training(hidden=(16,), **settings)


def moved(before, after):
    """Return the networks whose numbers differ."""
    return {leaf.partition("/")[0] for leaf in before if (before[leaf] != after[leaf]).any()}


def test_the_list_names_what_rllib_has():
    assert vars(AlgorithmConfig()).keys() >= HONOURED


@pytest.mark.parametrize(
    ("method", "given", "named"),
    [
        ("training", {"train_batch_size": 4000}, r"train_batch_size=4000.*smarts-bench settings ppo"),
        ("env_runners", {"num_env_runners": -1}, "num_env_runners=-1"),
        ("evaluation", {"evaluation_config": {"lr": 1e-9}}, "lr=1e-09"),
        ("rl_module", {"algorithm_config_overrides_per_module": {"agent_0": {"gamma": 0.5}}}, "'gamma'"),
    ],
)
def test_settings_without_effect_or_out_of_range_are_errors(method, given, named):
    with pytest.raises(ValueError, match=named):
        getattr(small(), method)(**given).validate()


def test_numbers_of_numpy_are_those_of_python():
    config = algorithms.config("ppo").training(lr=np.float32(0.25), minibatch_size=np.int64(16))
    config.validate()
    assert [type(value) for value in (config.lr, config.minibatch_size)] == [float, int]


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


@pytest.mark.parametrize("name", cases(PLAYING))
@pytest.mark.usefixtures("cluster")
def test_results_hold_what_users_look_for(build, name):
    config = small(name, Cues, **(LEARN if name in OFF_POLICY else {}))
    apart = takes(name, sharing="none")
    results = train(build(config.training(sharing="none" if apart else "all")), 4)["learners"]
    wanted = {"gradient_norm"}
    if name not in OFF_POLICY:
        wanted |= {"policy_loss", "entropy", "explained_variance"}
    if name in CLIPPED:
        wanted |= {"kl", "clip_fraction"}
    for policy in ("agent_0", "agent_1") if apart else ("shared",):
        assert all(np.isfinite(results[policy][key]) for key in wanted)
        assert (name in CLIPPED) == ("kl" in results[policy])


@pytest.mark.parametrize(("runners", "window"), [(0, 10), (4, 3)])
def test_returns_are_smoothed_over_as_many_episodes_whatever_the_number_of_runners(runners, window):
    config = small().reporting(metrics_num_episodes_for_smoothing=10)
    runner = config.env_runner_cls(config=config, num_workers=runners, worker_index=min(runners, 1))
    assert runner._recent.maxlen == window
    runner.stop()
