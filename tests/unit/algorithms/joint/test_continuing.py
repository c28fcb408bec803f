"""Training that is continued at any number of lifetime steps: restored, killed, restarted, never replayed."""

import os
import signal

import numpy as np
import pytest
from rigs import first, weights_of

import algorithms
from algorithms.errors import SpaceError
from algorithms.joint.adapter import JointVector
from algorithms.joint.episode_indices import FIRST_TEST_EPISODE
from algorithms.joint.evaluation import evaluate
from tests.games.games import Cues
from tests.games.null import LENGTH, NullVector

pytestmark = pytest.mark.usefixtures("cluster")

REPLAY = {"learning_starts": 16, "batch_size": 8, "capacity": 400, "checkpoint_replay": False}
FAMILIES = {
    "ppo": {"epochs": 1},
    "pg": {},
    "dqn": REPLAY,
    "networked_q": REPLAY,
}
RECURRENT = {"gru": 4, "sequence_length": 8}


def config_of(name, env=NullVector, runners=0, **settings):
    config = algorithms.config(name).environment(env).debugging(seed=3)
    config.env_runners(num_env_runners=runners, num_envs_per_env_runner=2, rollout_fragment_length=16)
    return config.training(**{"hidden": (8,), **FAMILIES.get(name, {}), **settings})


def lifetime(node, steps):
    """Return a state in which every count of a lifetime is this one."""
    if not isinstance(node, dict):
        return node
    if "lifetime_sum" in node:
        return {**node, "lifetime_sum": float(steps)}
    return {key: lifetime(value, steps) for key, value in node.items()}


def aged(build, config, steps, folder):
    """Save a training of so many steps; return its folder."""
    algo = build(config)
    algo.train()
    state = algo.get_state()
    algo.set_state({**state, "metrics_logger": lifetime(state["metrics_logger"], steps)})
    assert int(algo.runner_state()["num_env_steps_sampled_lifetime"]) == int(float(steps))
    algo.save_to_path(str(folder))
    return folder


def starts(algo):
    """Return how the episodes of each environment runner began."""
    group = algo.env_runner_group
    local = not algo.config.num_env_runners
    return group.foreach_env_runner(lambda runner: runner.env.begun, local_env_runner=local)


def test_a_training_continues_at_any_number_of_steps(build, tmp_path):
    folder = aged(build, config_of("ppo"), 2**40, tmp_path / "saved")
    first, again = build(config_of("ppo"), folder), build(config_of("ppo"), folder)
    for algo in (first, again):
        algo.train()
        algo.train()
    ((began, *more),) = starts(first)
    assert not more
    assert 0 <= began[0] < 2**63
    assert began[0] != 3  # the predecessor's
    assert began[1:] == (0, 1, 0)
    assert starts(again) == [[began]]
    one, other = weights_of(first), weights_of(again)
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_training_from_the_beginning_plays_the_seed_itself(build):
    algo = build(config_of("ppo"))
    algo.train()
    assert starts(algo) == [[(3, 0, 1, 0)]]


@pytest.mark.parametrize(
    ("name", "settings"),
    first(("dqn", RECURRENT), ("pg", {}), ("dqn", {}), ("networked_q", {}), ("ppo", RECURRENT)),
)
def test_every_family_continues(build, tmp_path, name, settings):
    config = config_of(name, **settings)
    folder = aged(build, config, 2**40, tmp_path / "saved")
    algo = type(build(config)).from_checkpoint(str(folder))
    before = weights_of(algo)
    for _ in range(3):
        result = algo.train()
    after = weights_of(algo)
    assert any(not np.array_equal(before[each], after[each]) for each in before)
    assert result["env_runners"]["num_env_steps_sampled_lifetime"] == 2**40 + 3 * 2 * 16
    algo.stop()


def test_a_restore_in_place_begins_the_same_new_episodes_each_time(build, tmp_path):
    algo = build(config_of("ppo"))
    algo.train()
    algo.save_to_path(str(tmp_path / "saved"))
    for _ in range(2):
        algo.train()
        algo.restore_from_path(str(tmp_path / "saved"))
        algo.train()
    ((first, second, third),) = starts(algo)
    assert first != second == third


def processes(algo):
    return algo.env_runner_group.foreach_env_runner(lambda runner: os.getpid(), local_env_runner=False)


@pytest.mark.nightly
def test_a_remote_runner_is_restored_killed_and_restarted(build, tmp_path):
    steps, config = 2**40, config_of("ppo", runners=1)
    folder = aged(build, config, steps, tmp_path / "saved")
    algo = build(config, folder)
    algo.train()
    ((restored,),) = starts(algo)
    assert restored[0] != 3
    algo.train()
    os.kill(processes(algo)[0], signal.SIGKILL)
    result = algo.train()["env_runners"]  # waits for the only runner
    assert result["num_env_steps_sampled_lifetime"] == steps + 3 * 2 * 16
    ((restarted,),) = starts(algo)
    assert restarted[1:] == restored[1:]
    assert restarted[0] not in (3, restored[0])


@pytest.mark.parametrize(("name", "settings"), first(("mf_q", {}), ("ppo", RECURRENT)))
def test_policies_with_leaves_of_their_own_are_evaluated_in_a_given_environment(build, name, settings):
    """As the benchmark validates and tests: what memories and neighbours add is not the environment's."""
    algo = build(config_of(name, **settings))
    algo.train()
    episodes = evaluate(algo, 3, env=NullVector())
    assert [(each.episode_index - FIRST_TEST_EPISODE, each.length) for each in episodes] == [
        (number, LENGTH) for number in range(3)
    ]
    with pytest.raises(SpaceError):
        evaluate(algo, 3, env=JointVector(lambda b: Cues(), 2))
