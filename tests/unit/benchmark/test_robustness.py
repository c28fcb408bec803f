"""Cross-play, wet roads and latency with tiny trainings: the tests' episodes wherever nothing differs."""

import shutil

import numpy as np
import pytest
import ray

from algorithms.joint.episode_indices import FIRST_TEST_EPISODE
from benchmark import load_policy
from benchmark.experiment import conditions as known_conditions
from benchmark.experiment.conditions import AS_TRAINED, Condition
from benchmark.experiment.config import read_experiment
from benchmark.experiment.models import Resources
from benchmark.experiment.runs import runs_of, scripted_runs_of
from benchmark.metrics import read_table
from benchmark.results.commands import keep_command
from benchmark.results.files import ResultsError, read_versioned, write_versioned
from benchmark.results.reading import read_results
from benchmark.results.robustness import PLAY, ROBUSTNESS, TABLE, Play, read_played, reference_rows
from benchmark.results.run_folder import RunFolder
from benchmark.running import robustness
from benchmark.running.cluster import start_ray
from benchmark.running.environments import environment
from benchmark.running.playing_together import TrainedDriver
from benchmark.running.robustness import Given, play_robustness, policies_of
from benchmark.running.testing import play_scripted
from benchmark.running.training import train_and_evaluate
from benchmark.running.writing import RunWriter
from smarts.errors import UnknownNameError

TASK, TRAFFIC = "intersection", "random_social_vehicles"
TINY = """
name: tiny
algorithms: [commnet, ppo]
tasks:
  - name: intersection
    scenarios: [intersection]
    test:
      - {name: alone, scenarios: [intersection], traffic: no_social_vehicles, seen: true}
      - {name: crossing, scenarios: [intersection], seen: true}
traffic: [random_social_vehicles]
seeds: [1]
environment: {agents: 3, time_limit: 12, observation: neighbor_rows}
budget: {agent_steps: 1000}
evaluation: {episodes: 3, modes: [greedy], validations: 0, validation_episodes: 1}
scripted: [gap_acceptance]
resources: {num_envs_per_env_runner: 2}
"""
SAME = ("outcome", "duration", "distance_travelled", "start_x", "start_y", "collisions", "goals")
"""Columns that are alike in two episodes only if these are."""
EVEN = np.array([True, False, True])
"""Agents at even places."""
NEUTRAL = {
    "neutral": Condition(
        label="Dry", meaning="As in training", environment={"friction": 0.9, "action_latency": 0.0}
    )
}


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Return the results folder of two tiny trainings."""
    folder = tmp_path_factory.mktemp("results")
    file = folder / "tiny.yaml"
    file.write_text(TINY)
    experiment, root = read_experiment(file), folder / "tiny"
    start_ray(Resources())
    keep_command(root, experiment, "smarts-bench run tiny.yaml")
    for run in runs_of(experiment):
        writer = RunWriter(run, RunFolder(root / run.folder))
        for message in train_and_evaluate(run, RunFolder(folder / "scratch" / run.label)):
            writer.take(message)
        writer.close()
    ray.shutdown()
    for run in scripted_runs_of(experiment):
        writer = RunWriter(run, RunFolder(root / run.folder))
        for message in play_scripted(run, RunFolder(folder / "scratch" / run.label)):
            writer.take(message)
        writer.close()
    return root


@pytest.fixture(scope="module")
def played(trained, tmp_path_factory):
    """Return a copy in which two plays of each kind were made."""
    root = tmp_path_factory.mktemp("played") / "tiny"
    shutil.copytree(trained, root)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(known_conditions, "conditions", lambda: NEUTRAL)
        given = Given(algorithms=("ppo", "commnet"), partners=("parked",), conditions=tuple(NEUTRAL))
        lines = [*play_robustness(root, given)]
    assert len(lines) == 2 * 3 + 3
    return root


@pytest.fixture
def copy(trained, tmp_path):
    shutil.copytree(trained, tmp_path / "tiny")
    return tmp_path / "tiny"


def rows(table):
    kept = table.sort_values(["world", "agent"]).reset_index(drop=True)
    return kept[[*SAME]].to_dict("list")


def of_test(root, name):
    return rows(reference_rows(read_results(root), TASK, TRAFFIC, name, 1))


def run_place(root, name):
    return root / name / TASK / TRAFFIC / "seed_1"


@pytest.mark.parametrize("name", ["ppo", "commnet"])
def test_a_condition_that_changes_nothing_plays_the_test_again(played, name):
    play = read_table(played / Play(TASK, TRAFFIC, "neutral", name, name, 1).folder / TABLE)
    assert rows(play) == of_test(played, name)


def test_of_two_conditions_of_the_test_the_first_in_the_training_s_traffic_is_played(played):
    play = read_table(played / Play(TASK, TRAFFIC, "neutral", "ppo", "ppo", 1).folder / TABLE)
    assert len(play) == 3 * 3
    assert set(play["condition"]) == {"neutral"}
    assert set(play["traffic"]) == {TRAFFIC}
    own = reference_rows(read_results(played), TASK, TRAFFIC, "ppo", 1)
    assert set(own["condition"]) == {"crossing (seen)"}
    between = read_table(played / Play(TASK, TRAFFIC, AS_TRAINED, "ppo", "parked", 1).folder / TABLE)
    assert set(between["condition"]) == {AS_TRAINED}


def test_two_halves_of_one_policy_play_the_test_again(trained, monkeypatch):
    (policies,) = policies_of(trained, Given(algorithms=("ppo",)))

    def drivers(env, *given):
        twins = [load_policy(run_place(trained, "ppo")) for _ in range(2)]
        return [(TrainedDriver(twins[k], agents, env), agents) for k, agents in enumerate((EVEN, ~EVEN))]

    monkeypatch.setattr(robustness, "_drivers", drivers)
    written = {}
    monkeypatch.setattr(robustness, "write_table", lambda table, path: written.update(table=table))
    monkeypatch.setattr(robustness, "write_versioned", lambda path, content: None)
    robustness._play(policies, Play(TASK, TRAFFIC, AS_TRAINED, "ppo", "twin", 1), {})
    assert rows(written["table"]) == of_test(trained, "ppo")


def test_partners_drive_the_agents_at_other_places_in_both_arrangements(played):
    for even, odd in (("ppo", "parked"), ("parked", "ppo")):
        table = read_table(played / Play(TASK, TRAFFIC, AS_TRAINED, even, odd, 1).folder / TABLE)
        assert set(table["world"]) == {FIRST_TEST_EPISODE + number for number in range(3)}
        for agent, driver, partner in zip(table["agent"], table["algorithm"], table["partner"], strict=True):
            is_even = int(agent.split("-")[1]) % 2 == 0
            assert (driver, partner) == ((even, odd) if is_even else (odd, even))
        parked = table[table["algorithm"] == "parked"]
        assert (parked["distance_travelled"] < 40.0).all()  # it brakes from its start on
        assert not (parked["outcome"] == "goal").any()


def test_messages_come_from_the_own_kind_alone(trained):
    even = EVEN
    policy = load_policy(run_place(trained, "commnet"))
    assert policy.needs_others
    assert not load_policy(run_place(trained, "ppo")).needs_others
    (policies,) = policies_of(trained, Given())
    env = environment(policies.setting)
    now = env.reset(1)
    (leaves,) = now.observations
    generator = np.random.default_rng(0)
    (wanted,) = policy.act_for(even, now, env.worlds)
    for _ in range(5):
        other = {name: array.copy() for name, array in leaves.items()}
        for array in other.values():
            array[:, ~even] = generator.normal(size=array[:, ~even].shape)
        policy.reset()
        (chosen,) = policy.act_for(even, now._replace(observations=(other,)), env.worlds)
        np.testing.assert_array_equal(chosen[:, even], wanted[:, even])
    env.close()


def test_a_scripted_partner_sees_what_it_sees_in_its_own_test(copy, monkeypatch):
    """It needs the vehicles in its vector; the trained ones have them as rows, and nothing else."""
    root = copy
    monkeypatch.setattr(known_conditions, "conditions", lambda: NEUTRAL)
    lines = [*play_robustness(root, Given(algorithms=("ppo",), conditions=("neutral",)))]
    assert len(lines) == 2 + 2
    for name in ("gap_acceptance", "ppo"):
        play = read_table(root / Play(TASK, TRAFFIC, "neutral", name, name, 1).folder / TABLE)
        assert rows(play) == of_test(root, name)
    together = read_table(root / Play(TASK, TRAFFIC, AS_TRAINED, "ppo", "gap_acceptance", 1).folder / TABLE)
    assert set(together["algorithm"]) == {"ppo", "gap_acceptance"}


def test_what_is_there_is_not_played_again_and_what_is_lost_is(played, tmp_path, monkeypatch):
    root = tmp_path / "tiny"
    shutil.copytree(played, root)
    monkeypatch.setattr(known_conditions, "conditions", lambda: NEUTRAL)
    given = Given(algorithms=("ppo", "commnet"), partners=("parked",), conditions=tuple(NEUTRAL))
    assert all(line.endswith(": was there") for line in play_robustness(root, given))
    lost = root / Play(TASK, TRAFFIC, AS_TRAINED, "ppo", "parked", 1).folder
    before = rows(read_table(lost / TABLE))
    (lost / PLAY).unlink()
    stale = root / Play(TASK, TRAFFIC, "neutral", "ppo", "ppo", 1).folder
    facts = read_versioned(stale / PLAY)
    write_versioned(stale / PLAY, {**facts, "trained": {"ppo": {"agent_steps": 1, "seconds": 1.0}}})
    left_out = read_played(read_results(root)).problems
    assert [*left_out] == [stale.relative_to(root).as_posix()]
    assert "ppo has been trained again since" in left_out[stale.relative_to(root).as_posix()]
    lines = [*play_robustness(root, given)]
    again = {line.split(" ", 1)[1] for line in lines if not line.endswith(": was there")}
    assert again == {f"ppo with parked, {TASK}, {TRAFFIC}, {AS_TRAINED}", f"ppo, {TASK}, {TRAFFIC}, neutral"}
    assert rows(read_table(lost / TABLE)) == before
    assert not read_played(read_results(root)).problems


def test_longer_plays_are_not_replaced_by_shorter_ones(played, monkeypatch):
    monkeypatch.setattr(known_conditions, "conditions", lambda: NEUTRAL)
    given = Given(episodes=2, algorithms=("ppo", "commnet"), partners=("parked",), conditions=())
    lines = [*play_robustness(played, given)]
    assert len(lines) == 6
    assert all(line.endswith(": was there") for line in lines)


@pytest.mark.parametrize(
    ("given", "kind", "said"),
    [
        (Given(partners=("gap_aceptance",)), UnknownNameError, "'gap_aceptance'"),
        (Given(algorithms=("dqn",)), UnknownNameError, "'dqn'"),
        (Given(episodes=4), ResultsError, "4 episodes, and the tests have 3"),
    ],
)
def test_what_is_not_there_is_named_before_anything_is_played(trained, given, kind, said):
    with pytest.raises(kind) as caught:
        policies_of(trained, given)
    assert said in str(caught.value)
    assert not (trained / ROBUSTNESS).exists()
