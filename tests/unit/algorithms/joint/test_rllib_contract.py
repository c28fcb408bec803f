"""The algorithms as RLlib algorithms: checkpoints, evaluation, faults, refusals."""

import math
import os
import signal
import time

import numpy as np
import pytest
from rigs import first, train, weights_of

import algorithms
from algorithms.errors import (
    CheckpointError,
    DamagedCheckpointError,
    SpaceError,
)
from tests.games.games import Broken, Constant, Cues, Hanging, Ragged

pytestmark = pytest.mark.usefixtures("cluster")

FAST = {
    "ppo": {"epochs": 2, "minibatch_size": 32},
    "dqn": {"learning_starts": 32, "batch_size": 16, "capacity": 500},
}


def small(name="ppo", env=Cues, runners=0, env_config=None, **settings):
    config = algorithms.config(name).environment(env, env_config=env_config or {})
    config.env_runners(num_env_runners=runners, num_envs_per_env_runner=2, rollout_fragment_length=16)
    return config.debugging(seed=3).training(**{"hidden": (16,), **FAST[name], **settings})


def assert_same(first, second):
    assert first.keys() == second.keys()
    for name, array in first.items():
        np.testing.assert_array_equal(array, second[name], err_msg=name)


def differ(first, second):
    return any(not np.array_equal(first[name], second[name]) for name in first)


@pytest.mark.parametrize(("name", "env"), first(("dqn", Cues), ("dqn", Ragged), ("ppo", Ragged)))
def test_restored_training_equals_uninterrupted_training(build, tmp_path, name, env):
    algo = build(small(name, env))
    train(algo, 3)
    algo.save_to_path(str(tmp_path / "checkpoint"))
    at_three, snapshot = weights_of(algo), algo.get_state()
    train(algo, 3)
    at_six = weights_of(algo)
    assert differ(at_three, at_six)

    fresh = type(algo).from_checkpoint(str(tmp_path / "checkpoint"))
    assert_same(weights_of(fresh), at_three)
    train(fresh, 3)
    assert_same(weights_of(fresh), at_six)
    fresh.stop()

    algo.restore_from_path(str(tmp_path / "checkpoint"))
    assert_same(weights_of(algo), at_three)
    train(algo, 3)
    assert_same(weights_of(algo), at_six)

    algo.set_state(snapshot)
    train(algo, 3)
    assert_same(weights_of(algo), at_six)


@pytest.mark.nightly
def test_restored_training_with_a_remote_runner_equals_uninterrupted_training(build, tmp_path):
    algo = build(small(runners=1))
    train(algo, 2)
    algo.save_to_path(str(tmp_path / "checkpoint"))
    train(algo, 2)
    expected = weights_of(algo)
    algo.restore_from_path(str(tmp_path / "checkpoint"))
    train(algo, 2)
    assert_same(weights_of(algo), expected)


def test_a_schedule_of_the_learning_rate_goes_by_environment_steps(build):
    algo = build(small(lr=[[0, 1e-3], [128, 1e-4]]))
    rates = []
    for _ in range(6):
        algo.train()
        learner = algo.learner_group._learner
        rates.append({g["lr"] for o in learner._optimizer_parameters for g in o.param_groups})
    # An iteration is 32 steps; the last ones lie behind the schedule's end.
    assert all(len(rate) == 1 for rate in rates)
    falling = [rate.pop() for rate in rates]
    assert falling[0] > falling[1] > falling[2] >= 1e-4
    assert falling[-2:] == pytest.approx([1e-4, 1e-4])


@pytest.mark.parametrize("name", first("ppo", "dqn"))
def test_the_first_update_after_a_restore_goes_by_the_new_learning_rate(build, tmp_path, name):
    """As population-based training restores: two iterations of 32 steps at one rate, the third at another."""
    old, new = 2.0**-10, 2.0**-6
    steps_down = [[0, old], [32, old], [64, new]]
    source, whole = build(small(name, lr=old)), build(small(name, lr=steps_down))
    train(source, 2)
    source.save_to_path(str(tmp_path / "checkpoint"))
    train(whole, 3)
    for lr in (new, steps_down):
        algo = build(small(name, lr=lr))
        algo.restore_from_path(str(tmp_path / "checkpoint"))
        train(algo, 1)
        assert_same(weights_of(algo), weights_of(whole))
    train(source, 1)
    assert differ(weights_of(source), weights_of(whole))


def test_evaluation_plays_exactly_the_episodes_asked_for_and_leaves_training_alone(build):
    config = small().evaluation(evaluation_duration=5).training(evaluate_sampled=True)
    algo, control = build(config), build(small())
    train(algo, 1)
    first = algo.evaluate()["env_runners"]
    again = algo.evaluate()["env_runners"]
    assert first["num_episodes"] == 5
    assert first["episode_return_mean"] == again["episode_return_mean"]
    assert first["sampled"]["episode_return_mean"] == again["sampled"]["episode_return_mean"]
    train(algo, 1)
    train(control, 2)
    assert_same(weights_of(algo), weights_of(control))


def actions_of(algo, left):
    """Train one iteration with so many actions left; return how many agents took."""
    algo.actions_left = left
    return sum(algo.train()["env_runners"]["num_agent_steps_sampled"].values())


def test_an_update_is_cut_to_the_actions_that_are_left(build):
    """A budget of two whole updates changes no bit; a third is of whole steps of all environments."""
    algo, control = build(small()), build(small())
    first, second = (actions_of(control, math.inf) for _ in range(2))
    assert [actions_of(algo, first + second), actions_of(algo, second)] == [first, second]
    assert_same(weights_of(algo), weights_of(control))
    assert 5 <= actions_of(algo, 5) < 5 + 2 * len(algo.spec.agents) < first
    assert differ(weights_of(algo), weights_of(control))


@pytest.mark.parametrize(
    ("settings", "runners", "steps"), first(({"gru": 8, "sequence_length": 4}, 0, 4), ({}, 2, 1))
)
def test_a_cut_update_is_of_whole_sequences_and_of_equal_steps_on_all_runners(
    build, settings, runners, steps
):
    algo = build(small(env=Constant, runners=runners, **settings))
    assert actions_of(algo, 1) == steps * 2 * max(runners, 1) * len(algo.spec.agents)
    actions_of(algo, math.inf)


class Crowd(Constant):
    def __init__(self, config):
        super().__init__(agents=config["agents"])


def test_an_evaluation_with_other_agents_is_refused():
    config = small(env=Crowd, env_config={"agents": 2})
    config.evaluation(evaluation_interval=1, evaluation_config={"env_config": {"agents": 3}})
    with pytest.raises(SpaceError, match=r"evaluation_config.*agent_2"):
        config.build_algo()


@pytest.mark.nightly
def test_the_episodes_of_a_lost_evaluation_runner_are_played_by_another(build):
    expected = build(small().evaluation(evaluation_duration=5)).evaluate()["env_runners"]
    algo = build(
        small().evaluation(evaluation_interval=1, evaluation_num_env_runners=2, evaluation_duration=5)
    )
    os.kill(pids_of(algo.eval_env_runner_group)[0], signal.SIGKILL)
    for _ in range(2):  # the loss is found in the first, and known in the second
        found = algo.evaluate()["env_runners"]
        assert found["num_episodes"] == 5
        for name in ("episode_return_mean", "episode_return_min", "episode_return_max"):
            assert found[name] == pytest.approx(expected[name], rel=1e-12)


def test_a_checkpoint_of_another_algorithm_or_sharing_is_refused(build, tmp_path):
    algo = build(small())
    train(algo, 1)
    algo.save_to_path(str(tmp_path / "checkpoint"))
    before = weights_of(other := build(small("dqn")))
    with pytest.raises(CheckpointError, match=r"ppo .*dqn"):
        other.restore_from_path(str(tmp_path / "checkpoint"))
    assert_same(before, weights_of(other))
    with pytest.raises(CheckpointError, match="group 'shared'"):
        build(small(sharing="all")).restore_from_path(str(tmp_path / "checkpoint"))
    with pytest.raises(CheckpointError, match="action space"):
        build(small(env=Constant)).restore_from_path(str(tmp_path / "checkpoint"))


def test_a_checkpoint_of_other_networks_is_refused_with_the_settings_that_differ(build, tmp_path):
    algo = build(small())
    train(algo, 1)
    algo.save_to_path(str(tmp_path / "checkpoint"))
    other = build(small(hidden=[8], normalize_values=True, lr=1.0))
    before = weights_of(other)
    both = r"hidden: \(16,\).*\(8,\).*normalize_values: False.*True"
    with pytest.raises(CheckpointError, match=both):
        other.restore_from_path(str(tmp_path / "checkpoint"))
    with pytest.raises(CheckpointError, match=both):
        other.set_state(algo.get_state())
    assert_same(before, weights_of(other))
    build(small(lr=1.0, hidden=[16])).set_state(algo.get_state())


@pytest.mark.parametrize(
    ("part", "damage"),
    [("algorithm_state.pkl", "cut"), ("learner/rl_module/agent_0/module_state.pkl", "missing")],
)
def test_a_damaged_checkpoint_is_named(build, tmp_path, part, damage):
    algo = build(small())
    folder = tmp_path / "checkpoint"
    algo.save_to_path(str(folder))
    file = next(each for each in sorted(folder.rglob("*.pkl")) if str(each).endswith(part))
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:50])
    else:
        file.unlink()
    with pytest.raises(DamagedCheckpointError, match=str(folder)):
        algo.restore_from_path(str(folder))


@pytest.mark.parametrize("fault", [{"raise_at": 3}, {"nan_at": 3}])
def test_broken_episodes_are_counted_and_replaced(build, fault):
    algo = build(small(env=Broken, env_config={**fault, "chance": 0.5}))
    result = train(algo, 3)["env_runners"]
    assert result["num_failed_envs_lifetime"] > 0
    assert result["num_episodes_lifetime"] > 0
    assert all(np.isfinite(w).all() for w in weights_of(algo).values())


@pytest.mark.nightly
def test_training_survives_sigkill_of_a_runner(build):
    algo = build(small(runners=2))
    train(algo, 1)
    os.kill(pids_of(algo.env_runner_group)[0], signal.SIGKILL)
    steps = [train(algo, 1)["env_runners"]["num_env_steps_sampled_lifetime"]]
    deadline = time.monotonic() + 60
    while algo.env_runner_group.num_healthy_remote_workers() < 2 and time.monotonic() < deadline:
        steps.append(train(algo, 1)["env_runners"]["num_env_steps_sampled_lifetime"])
    train(algo, 1)
    assert algo.env_runner_group.num_healthy_remote_workers() == 2
    assert steps == sorted(steps)


def pids_of(group):
    return group.foreach_env_runner(lambda runner: os.getpid(), local_env_runner=False)


@pytest.mark.nightly
def test_a_hung_runner_is_killed_and_comes_back(build, tmp_path):
    file = tmp_path / "hang"
    config = small(env=Hanging, runners=2, env_config={"file": str(file)})
    algo = build(config.env_runners(sample_timeout_s=5))
    train(algo, 1)
    file.touch()
    result = train(algo, 1)
    assert result["num_hung_env_runners_killed"] == 1
    deadline = time.monotonic() + 60
    while algo.env_runner_group.num_healthy_remote_workers() < 2 and time.monotonic() < deadline:
        train(algo, 1)
    train(algo, 1)
    assert algo.env_runner_group.num_healthy_remote_workers() == 2


def test_own_evaluation_plays_fixed_worlds(build):
    from algorithms.joint.evaluation import evaluate

    algo = build(small())
    train(algo, 1)
    episodes = evaluate(algo, 5)
    assert [episode.episode_index for episode in episodes] == list(range(2_000_000, 2_000_005))
    again = evaluate(algo, 3)
    assert [e.returns.tolist() for e in again] == [e.returns.tolist() for e in episodes[:3]]
    # Another seed: other episodes, the same ones again.
    first, second = ([e.returns.tolist() for e in evaluate(algo, 5, seed=7)] for _ in range(2))
    assert first == second
    assert first != [e.returns.tolist() for e in episodes]


@pytest.mark.nightly
def test_runs_under_tune_with_its_own_class_and_settings(tmp_path):
    from ray import tune

    config = small(hidden=tune.grid_search([(8,), (16,)]))
    tuner = tune.Tuner(
        config.algo_class,
        param_space=config,
        run_config=tune.RunConfig(stop={"training_iteration": 2}, storage_path=str(tmp_path), verbose=0),
        tune_config=tune.TuneConfig(max_concurrent_trials=1),
    )
    results = tuner.fit()
    assert not results.errors
    assert sorted(r.config["hidden"] for r in results) == [(8,), (16,)]
    assert all(r.metrics["env_runners"]["num_env_steps_sampled_lifetime"] == 64 for r in results)
