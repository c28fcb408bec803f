"""Cross-play and robustness in the report, from rows made by hand."""

import csv

import numpy as np
import pytest

from benchmark.experiment.conditions import AS_TRAINED, Condition, condition, conditions
from benchmark.experiment.environment import Environment
from benchmark.metrics import write_table
from benchmark.report.content import make_report
from benchmark.report.robustness import robustness_of
from benchmark.report.writing import write_report
from benchmark.results.files import write_versioned
from benchmark.results.reading import read_results
from benchmark.results.robustness import PLAY, TABLE, Play
from smarts.config import ConfigError
from smarts.errors import UnknownNameError
from tests.hand_made_results import SOCIAL, agent_episodes, write_experiment, write_run

TASK = "intersection"
GOALS, CRASHES = [["goal", "goal"]] * 10, [["collision", "collision"]] * 10
TRAINED = {"agent_steps": 1000, "seconds": 10.0}


def write_play(root, name, even, odd, outcomes, seed=1, **facts):
    """Write a play; `even` drives agent_0, `odd` agent_1."""
    table = agent_episodes(outcomes, task=TASK, task_traffic=SOCIAL, mode="greedy", training_seed=seed)
    counts = table.attrs
    is_even = table["agent"] == "agent_0"
    table["algorithm"] = np.where(is_even, even, odd)
    table["partner"], table["condition"] = np.where(is_even, odd, even), name
    table.attrs = counts
    play = Play(TASK, SOCIAL, name, even, odd, seed)
    trained = {driver: TRAINED for driver in play.drivers if driver != "parked"}
    content = {"task": TASK, "traffic": SOCIAL, "condition": name, "even": even, "odd": odd, "episodes": 10}
    content |= {"training_seed": seed, "trained": trained, "commit": "abc", "needs_others": ["dqn"]}
    content["environment"] = {} if name == AS_TRAINED else condition(name).environment
    (root / play.folder).mkdir(parents=True)
    write_table(table, root / play.folder / TABLE)
    write_versioned(root / play.folder / PLAY, {**content, **facts})
    return root / play.folder


@pytest.fixture
def root(tmp_path):
    """PPO arrives and DQN crashes alone; together PPO's agent_0 crashes, and DQN arrives."""
    write_experiment(tmp_path, algorithms=["ppo", "dqn"], tasks=[TASK], traffic=[SOCIAL], scripted=["parked"])
    for name, outcomes in (("ppo", GOALS), ("dqn", CRASHES)):
        table = agent_episodes(outcomes, mode="greedy", task=TASK, task_traffic=SOCIAL)
        write_run(tmp_path, name, [table], traffic=SOCIAL)
    stands = [["not_moving"] * 2] * 10
    parked = [agent_episodes(stands, mode="scripted", task=TASK, task_traffic=SOCIAL)]
    write_run(tmp_path, "parked", parked, traffic=SOCIAL, seed=-1)
    write_play(tmp_path, AS_TRAINED, "ppo", "dqn", [["collision", "goal"]] * 10)
    write_play(tmp_path, AS_TRAINED, "dqn", "ppo", GOALS)
    write_play(tmp_path, AS_TRAINED, "ppo", "parked", [["goal", "not_moving"]] * 10)  # one arrangement only
    write_play(tmp_path, "wet_road", "ppo", "ppo", [["goal", "off_road"]] * 10)
    return tmp_path


def values(root):
    found = robustness_of(make_report(read_results(root)))
    rows = found.values.to_dict("records")
    return found, {(row["policy"], row["kind"], row["with"], row["metric"]): row for row in rows}


def test_a_policy_is_measured_alone_in_both_arrangements_and_compared_with_its_own_test(root):
    found, rows = values(root)
    played = rows["ppo", "partner", "dqn", "collision_rate"]
    assert (played["value"], played["n"], played["episodes"]) == (0.5, 20, 10)
    assert (played["difference"], played["change"]) == (0.5, "worse")
    # Ten gaps of 0.5: error sqrt(2.5 + 1 - 25 / 12) / 12 of matched pairs, t = 5.04, 9 degrees of freedom.
    assert played["p_value"] == pytest.approx(0.0007, abs=1e-4)
    assert rows["dqn", "partner", "ppo", "completion_rate"]["change"] == "better"
    assert rows["ppo", "partner", "self-play", "completion_rate"]["value"] == 1.0
    assert rows["dqn", "partner", "self-play", "completion_rate"]["value"] == 0.0
    assert rows["ppo", "partner", "XP", "collision_rate"]["difference"] == 0.5
    wet = rows["ppo", "condition", "wet_road", "completion_rate"]
    assert (wet["value"], wet["difference"], wet["change"]) == (0.5, -0.5, "worse")
    assert rows["ppo", "condition", "wet_road", "collision_rate"]["change"] == ""
    assert not [key for key in rows if "parked" in key]
    partners, under = found.matrices
    assert partners.columns == ("Self-play", "DQN", "PPO", "XP")
    assert [label for label, _ in partners.rows] == ["DQN*", "PPO"]
    (_, entries) = partners.rows[1]
    assert entries[0].figures == "0.00 / 1.00"
    assert entries[1].figures == "0.50 / 0.50"
    assert entries[1].change == "worse: collision +0.50, worse: completion -0.50"
    assert entries[2] is None
    assert under.columns == ("Test", "Wet road")
    assert not found.left_out


def test_the_mean_over_partners_is_paired_with_the_test_as_often(root):
    write_play(root, AS_TRAINED, "parked", "ppo", [["not_moving", "goal"]] * 10)
    found, rows = values(root)
    assert any("PPO: mean over 2 partners" in note for note in found.notes)  # DQN has one
    mean = rows["ppo", "partner", "XP", "collision_rate"]
    assert (mean["value"], mean["n"], mean["difference"]) == (0.25, 40, 0.25)
    assert mean["note"] == "mean over 2 partners"
    assert rows["ppo", "partner", "parked", "collision_rate"]["difference"] == 0.0
    assert rows["parked", "partner", "ppo", "completion_rate"]["value"] == 0.0


def test_all_files_of_the_report_have_it(root):
    page = write_report(root)
    text, html = (page.with_name(name).read_text() for name in ("report.md", "report.html"))
    for each in (text, html):
        assert "Cross-play and robustness" in each
        assert "0.50 / 0.50" in each
        assert "its own kind only" in each
        assert "abc" in each
    with page.with_name("robustness.csv").open() as file:
        rows = [*csv.DictReader(file)]
    assert len(rows) == 2 * (3 + 3 + 2)


def test_plays_that_do_not_fit_are_left_out_by_name(root):
    ice = write_play(root, "latency_300", "ppo", "ppo", GOALS, environment={"action_latency": 0.4})
    stale = write_play(root, "latency_500", "ppo", "ppo", GOALS, trained={"ppo": {**TRAINED, "seconds": 9.0}})
    gone = write_play(root, "latency_500", "maac", "maac", GOALS)
    cut = write_play(root, "latency_500", "dqn", "dqn", GOALS)
    (cut / TABLE).write_bytes((cut / TABLE).read_bytes()[:-30])
    write_play(root, "latency_300", "dqn", "dqn", GOALS, seed=2, trained={})
    found, rows = values(root)
    left_out = dict(line.split(": ", 1) for line in found.left_out)
    plays = (ice, stale, gone, cut)
    assert {*left_out} == {"robustness", *(each.relative_to(root).as_posix() for each in plays)}
    assert "[1, 2]" in left_out["robustness"]
    assert "ppo has been trained again since" in left_out[stale.relative_to(root).as_posix()]
    assert "another one now" in left_out[ice.relative_to(root).as_posix()]
    assert not [key for key in rows if "latency" in key[2]]


def test_conditions_change_the_environment_and_nothing_else():
    given = Environment(agents=3, time_limit=12.0, flat_tyres=[1])
    for name, each in conditions().items():
        changed = condition(name).of(given)
        assert changed != given
        kept = {key: value for key, value in dict(changed).items() if key not in each.environment}
        assert kept == {key: value for key, value in dict(given).items() if key not in each.environment}
    assert condition("wet_road").of(given).friction == 0.5
    assert condition("latency_300").of(given).action_latency == 0.3
    with pytest.raises(UnknownNameError, match="wet_road"):
        condition("wet_raod")
    with pytest.raises(ConfigError, match="frictoin"):
        Condition(label="", meaning="", environment={"frictoin": 0.5}).of(given)
