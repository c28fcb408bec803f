"""Which episodes a test consists of: those that do not count are made up for by the worlds that follow."""

import re

import pandas as pd

from benchmark.cli.experiments import show_metrics
from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Evaluation, Experiment, TrainingTask
from benchmark.experiment.runs import TaskSetting, scripted_runs_of
from benchmark.metrics import join_tables
from benchmark.metrics.table import read_table
from benchmark.report.writing import write_report
from benchmark.results.run_folder import FINISHED, RunFolder
from benchmark.running.testing import Part, measure_part, play_scripted
from smarts.types.events import Outcome
from tests.hand_made_results import agent_episodes, write_run
from tests.recordings import Drive, at_speed, record, straight

ROAD = straight(lanes=2, length=200.0)
FIRST = 2_000_000


def measured(folder, episodes, *, invalid=(), missing=(), cut=(), keep=False):
    """Play a part of a test by hand; return its table, and which worlds were played in which rounds."""
    rounds = []

    def play(part, worlds, store):
        rounds.append([world - FIRST for world in worlds])
        # Simulations that are done go on with further worlds, which are then cut short or even finished.
        for number in [*rounds[-1], rounds[-1][-1] + 1]:
            end = Outcome.INVALID if number in invalid else Outcome.GOAL
            drive = Drive(["road_0"], at_speed(5.0, 20, 10.0), agent="a", outcome=end)
            facts = {"is_invalid": number in invalid, "is_complete": number not in cut}
            if number not in missing:
                record(store, ROAD, [drive], name=f"w{number}", world=FIRST + number, **facts)

    part = Part("greedy", {"hand_made": 1.0}, episodes)
    task = TrainingTask(name="hand_made", scenarios=("loop",))
    cell = TaskSetting(task, "hand_made", Environment(), Evaluation(keep_episodes=keep), 1)
    return join_tables([*measure_part(part, folder, {}, play, cell)]), rounds


def worlds_of(table):
    return (table["world"] - FIRST).tolist()


def test_as_many_as_are_asked_for_are_played_once(tmp_path):
    table, rounds = measured(tmp_path, 3)
    assert rounds == [[0, 1, 2]]
    assert worlds_of(table) == [0, 1, 2]
    assert table.attrs["episodes"] == {"measured": 3, "invalid": 0, "incomplete": 0, "corrupted": {}}
    assert not [*tmp_path.iterdir()]


def test_for_each_that_does_not_count_the_next_world_is_played(tmp_path):
    table, rounds = measured(tmp_path, 4, invalid={1, 4}, missing={2}, cut={3}, keep=True)
    assert rounds == [[0, 1, 2, 3], [4, 5, 6], [7]]
    assert worlds_of(table) == [0, 1, 4, 5, 6, 7]
    assert worlds_of(table[~table["is_invalid"]]) == [0, 5, 6, 7]
    assert table.attrs["episodes"] == {"measured": 4, "invalid": 2, "incomplete": 2, "corrupted": {}}
    assert {path.name for path in tmp_path.iterdir()} == {
        *("greedy-hand_made", "greedy-hand_made-2", "greedy-hand_made-3")
    }


def test_a_scripted_policy_gets_the_observation_that_it_reads(tmp_path):
    """The gap-acceptance policy drives alike, whatever the experiment's agents observe."""
    tables = []
    for name, observation in (("benchmark", "benchmark"), ("few", ["speed", "action_mask"])):
        environment = {"observation": observation, "reward": "route_metres", "agents": 2}
        experiment = Experiment(
            name=name,
            algorithms=["ppo"],
            tasks=["intersection"],
            traffic=["random_social_vehicles"],
            scripted=["gap_acceptance"],
            environment=environment,
            evaluation={"episodes": 1, "held_out_episodes": 0},
        )
        (run,) = scripted_runs_of(experiment)
        folder = RunFolder(tmp_path / name)
        folder.path.mkdir()
        *_, noted = play_scripted(run, folder)
        assert noted.values["status"] == FINISHED
        tables.append(read_table(folder.table))
    assert len(tables[0]) == 2
    pd.testing.assert_frame_equal(*tables)


def test_a_test_says_its_conditions_and_which_ways_meet(tmp_path, capsys):
    tests = [{"name": name, "scenarios": [each]} for name, each in (("a", "intersection"), ("b", "two_way"))]
    experiment = Experiment(
        name="mine",
        tasks=[{"name": "mine", "train": ["loop"], "test": tests}],
        traffic=["no_social_vehicles"],
        scripted=["parked"],
        environment={"time_limit": 1},
        evaluation={"episodes": 1},
    )
    (run,) = scripted_runs_of(experiment)
    folder = RunFolder(tmp_path)
    for _ in play_scripted(run, folder):
        pass
    table = read_table(folder.table)
    assert set(table["split"]) == {"test"}
    # All four cross the intersection; on the road all keep to their lanes.
    meets = table.groupby("condition")["meets"].agg(list).to_dict()
    assert meets == {"a": [1.0] * 4, "b": [0.0] * 4}
    show_metrics(table)
    said = capsys.readouterr().out
    assert "of a, b, no_social_vehicles" in said
    rows = re.findall(r"^ +(a|b|agents that meet|others): collision_rate 0.000", said, re.MULTILINE)
    assert rows == ["a", "agents that meet", "b", "others"]
    show_metrics(table[table["condition"] == "a"])
    assert "with ways that meet within 5 s: 1.00 / 1.00" in capsys.readouterr().out


def test_a_report_shows_each_condition_of_a_test(tmp_path):
    ends = {"unseen": [["goal"], ["goal"], ["collision"], ["goal"]], "dense": [["collision"], ["goal"]]}
    given = {"mode": "greedy", "split": "test"}
    tables = [agent_episodes(each, condition=name, meets=1.0, **given) for name, each in ends.items()]
    tables.append(agent_episodes([["goal"], ["goal"]], condition="unseen", meets=0.0, seed=43, **given))
    write_run(tmp_path, "ppo", tables)
    text = write_report(tmp_path).with_suffix(".md").read_text()
    rows = [
        line.split(" | ") for line in text.partition("## By condition")[2].splitlines() if "greedy" in line
    ]
    figures = {row[4]: [row[5].split()[0], row[6].split()[0], *row[8:12]] for row in rows[:2]}
    assert figures == {
        # Of six, four meet another agent; the easy two do not hide what becomes of these.
        "unseen": ["0.83", "0.17", "0.67 / 0.67", "0.75 / 0.25", "1.00 / 0.00", "6"],
        "dense": ["0.50", "0.50", "1.00 / 1.00", "0.50 / 0.50", "", "2"],
    }
    assert "By condition" in write_report(tmp_path).read_text()
    # One scenario alone has a row for the agents that meet.
    write_run(tmp_path / "one", "ppo", [agent_episodes([["goal"]], mode="greedy")])
    assert "By condition" not in write_report(tmp_path / "one").read_text()
    write_run(tmp_path / "met", "ppo", [agent_episodes([["goal"]], mode="greedy", meets=1.0)])
    assert "1.00 / 1.00" in write_report(tmp_path / "met").read_text().partition('id="by-condition"')[2]
