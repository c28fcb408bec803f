"""Trained policies in one's own loop: the same actions as `evaluate` plays, whatever the environment."""

import shutil
from contextlib import closing
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
import ray

from algorithms.joint.episode_indices import FIRST_TEST_EPISODE
from benchmark import load_policy
from benchmark.experiment.models import Evaluation, Resources
from benchmark.metrics import read_table
from benchmark.results.files import ResultsError
from benchmark.results.run_folder import RunFolder
from benchmark.running.cluster import start_ray
from benchmark.running.environments import environment
from benchmark.running.evaluating import Asked, evaluate_checkpoint
from benchmark.running.given_steps import fill
from benchmark.running.testing import ENGINE, EVALUATION_SEED, play_test
from benchmark.running.training import _play, algorithm_of, restore
from smarts.agents.benchmark import benchmark_interface
from smarts.config import ConfigError
from smarts.env import HiWayEnv, SingleHiWayEnv, VectorHiWayEnv, hiway_parallel_env
from smarts.errors import ActionError
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from tests.raising import raises
from tests.unit.benchmark.untrained import write_untrained

NIGHTLY = pytest.mark.nightly

TINY = """
algorithms: [{name}]
tasks: [loop]
traffic: [no_social_vehicles]
seeds: [3]
settings: {{{name}: {settings}}}
environment: {{agents: {agents}}}
resources: {{num_envs_per_env_runner: 2}}
"""


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    """Return the folder of a run whose checkpoint is of an untrained policy."""
    start_ray(Resources())

    def make(name, settings="{}", agents=2):
        tiny = TINY.format(name=name, settings=settings, agents=agents)
        return write_untrained(tmp_path_factory.mktemp(name), tiny)

    yield make
    ray.shutdown()


def table_of_training(run, folder, out):
    """Return the table that the training itself would write of its last policy."""
    evaluation = Evaluation(episodes=2, keep_episodes=True)
    run = replace(run, task_setting=replace(run.task_setting, evaluation=evaluation))
    with algorithm_of(run) as algo:
        restore(algo, folder.checkpoint)
        for _ in play_test(run, out, algo.config.gamma, partial(_play, algo)):
            pass
    return read_table(out.table)


def decisions(root):
    """Return what was decided in each recorded episode by world: agents' agents, steps, actions."""
    found = {}
    for path in episodes_in(root):
        episode = RecordedEpisode(path)
        table = episode.table("decisions")
        chosen = np.column_stack([table["agent_id"], table["step"], table["value_0"]])
        if episode.facts["is_complete"]:
            found[int(episode.facts["world"])] = chosen.tolist()
    return found


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("ppo", "{gru: 8, sharing: all}"),
        *(pytest.param(name, "{}", marks=NIGHTLY) for name in ("mf_q", "maddpg")),
    ],
)
def test_the_actions_are_those_of_evaluate(make, tmp_path, name, settings):
    run, folder = make(name, settings)
    tested = evaluate_checkpoint(folder.path, Asked(episodes=2, out=tmp_path / "out"))
    pd.testing.assert_frame_equal(tested, table_of_training(run, folder, RunFolder(tmp_path / "test")))
    wanted = decisions(tmp_path / "out" / "episodes" / "greedy-loop")
    policy = load_policy(folder.path)
    with closing(environment(run.task_setting, num_envs=1, record=tmp_path / "own")) as env:
        now, over = env.reset(EVALUATION_SEED, np.array([FIRST_TEST_EPISODE]), stride=1), 0
        while over < 2:
            now = env.step(policy.act(now))
            over += int(now.reset.sum())
    got = decisions(tmp_path / "own")
    assert {FIRST_TEST_EPISODE, FIRST_TEST_EPISODE + 1} <= wanted.keys() & got.keys()
    for world in (FIRST_TEST_EPISODE, FIRST_TEST_EPISODE + 1):
        assert got[world] == wanted[world]


def test_a_checkpoint_without_what_learners_need_is_evaluated_alike(make, tmp_path):
    """Optimisers and critics may be left out."""
    _, folder = make("maddpg")
    kept = tmp_path / "run"
    shutil.copytree(folder.path, kept)
    learner = kept / "checkpoint" / "learner_group" / "learner"
    critics = [*(learner / "rl_module").glob("*__*")]
    states = [file for part in (kept / "checkpoint", learner.parent, learner) for file in part.glob("*.pkl")]
    assert critics
    assert states
    for critic in critics:
        shutil.rmtree(critic)
    for state in states:
        state.unlink()
    given = {"asked": Asked(episodes=2), "modes": ("greedy",)}
    pd.testing.assert_frame_equal(
        evaluate_checkpoint(kept, **given), evaluate_checkpoint(folder.path, **given)
    )


def test_a_test_on_another_traffic_engine_says_so(make):
    _, folder = make("ppo")
    tested = evaluate_checkpoint(folder.path, Asked(episodes=1, engine="Native"), modes=("greedy",))
    assert tested.attrs[ENGINE] == "tested on the traffic engine Native"
    with pytest.raises(ConfigError, match="no traffic engine 'Nativ'; did you mean 'Native'"):
        evaluate_checkpoint(folder.path, Asked(engine="Nativ"))


def by_dicts(env, policy, steps=12):
    """Return the actions of an environment whose observations are dicts, while all its agents are there."""
    policy.reset()
    with closing(env):
        observations, infos = env.reset(seed=7)
        found = []
        for _ in range(steps):
            actions = policy.act(observations, infos)
            found.append(actions)
            observations, *_, infos = env.step(actions)
    return found


def test_every_environment_gets_the_same_actions(make):
    from smarts.env import RLlibHiWayEnv

    _, folder = make("ppo", "{gru: 8}")
    policy = load_policy(folder.checkpoint)
    vector = VectorHiWayEnv(1, ["loop"], 2, traffic=["no_social_vehicles"])
    wanted = []
    with closing(vector):
        now = vector.reset(7)
        for _ in range(12):
            (actions,) = policy.act(now)
            wanted.append(dict(zip(policy.agents, actions[0].tolist(), strict=True)))
            now = vector.step([actions])
    assert len({tuple(each.values()) for each in wanted}) > 1, (
        "a policy that always does the same shows little"
    )
    common = {"scenarios": ["loop"], "traffic": ["no_social_vehicles"]}
    assert by_dicts(hiway_parallel_env(["loop"], 2, traffic=["no_social_vehicles"]), policy) == wanted
    assert by_dicts(RLlibHiWayEnv({**common, "agents": 2}), policy) == wanted
    common["agent_specs"] = dict.fromkeys(policy.agents, benchmark_interface())
    hasty = HiWayEnv(**common)
    with raises(ActionError, "Policy.attach", values=["decision_interval=5"]):
        policy.attach(hasty)
    hasty.close()
    objects = HiWayEnv(decision_interval=5, **common)
    with raises(ActionError, "Policy.act", values=["attach"]):
        policy.act(objects.reset(seed=7)[0])
    policy.attach(objects)
    assert by_dicts(objects, policy) == wanted


def test_one_agent_of_a_gymnasium_environment(make):
    _, folder = make("ppo", agents=1)
    policy = load_policy(folder.path, mode="sampled", seed=1)
    env = SingleHiWayEnv(["loop"], traffic=["no_social_vehicles"])
    found = by_dicts(env, policy, 8)
    assert all(isinstance(action, int) and action in range(4) for action in found)
    again = load_policy(folder.path, mode="sampled", seed=1)
    assert by_dicts(SingleHiWayEnv(["loop"], traffic=["no_social_vehicles"]), again, 8) == found


def test_what_is_no_observation_is_named(make):
    _, folder = make("pg")
    policy = load_policy(folder.path)
    with raises(ActionError, "Policy.act", values=["agent-7"]):
        policy.act({"agent-0": np.zeros(201), "agent-7": np.zeros(201)})
    with raises(ActionError, "Policy.act", values=[(3,), (201,)]):
        policy.act({"agent-0": np.zeros(3, np.float32)})
    for seen in ({"goal": np.zeros(2)}, {"goal": {}}, {"goal/x": [[1.0], [1.0, 2.0]]}):
        with raises(ActionError, "Policy.act", values=["no array 'goal/x'", "agent-0"]):
            fill("agent-0", seen, {"goal/x": np.zeros(())})
    whole = {"agent-0": np.zeros(201, np.float32)}
    with raises(ActionError, "Policy.act", values=["action_mask", "agent-0"]):
        policy.act(whole, {})
    only_slower = {"agent-0": {"action_mask": np.array([0, 1, 0, 0])}}
    assert policy.act(whole, only_slower) == {"agent-0": 1}
    assert policy.act({}, {}) == {}
    with raises(ResultsError, folder.path, values=["best"]):
        load_policy(folder.path, checkpoint="best")
    with pytest.raises(ResultsError, match="greedyy"):
        load_policy(folder.path, mode="greedyy")
