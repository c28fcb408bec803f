"""What a report reads: whole runs are used, everything else is named."""

import json

import pandas as pd
import pytest

from benchmark.metrics import read_table, write_table
from benchmark.report.provenance import gaps, totals
from benchmark.results.files import ResultsError
from benchmark.results.reading import NOT_BEGUN, UNREADABLE, read_results
from tests.hand_made_results import ALONE, agent_episodes, write_experiment, write_run
from tests.raising import raises

TWO = [["goal", "goal"], ["collision", "goal"]]


def greedy(outcomes=TWO, **labels):
    return [agent_episodes(outcomes, mode="greedy", **labels)]


def test_runs_that_are_there_under_way_and_missing(tmp_path):
    write_experiment(tmp_path, seeds=[1, 2, 3], scripted=["parked"])
    write_run(tmp_path, "ppo", greedy(), seed=1)
    write_run(tmp_path, "ppo", None, seed=2, progress=[[1, 400, 2.0, 200, -1.5, 0.25, 0.5, "", "", ""]])
    results = read_results(tmp_path)
    assert [(run.algorithm, run.seed, run.status) for run in results.runs] == [
        ("ppo", 1, "finished"),
        ("ppo", 2, "training"),
        ("ppo", 3, NOT_BEGUN),
        ("parked", -1, NOT_BEGUN),
    ]
    assert [run.seed for run in results.finished] == [1]
    assert results.runs[1].progress.loc[0, "completion"] == 0.25
    assert len(results.table) == 4
    assert not results.problems


def test_damaged_and_foreign_files_are_named_and_left_out(tmp_path):
    write_experiment(tmp_path, algorithms=["ppo", "dqn", "maac", "a2c"], seeds=[1, 2])
    good = write_run(tmp_path, "ppo", greedy())
    cut = write_run(tmp_path, "dqn", greedy()) / "episodes.parquet"
    cut.write_bytes(cut.read_bytes()[:-40])
    foreign = write_run(tmp_path, "maac", greedy()) / "episodes.parquet"
    foreign.write_bytes((good / "episodes.parquet").read_bytes())
    (write_run(tmp_path, "a2c", greedy()) / "run.json").write_text('{"status": "fini')
    (write_run(tmp_path, "a2c", greedy(), seed=2) / "config.yaml").write_text("a: [")
    (tmp_path / "dqn" / "intersection" / ALONE / "seed_2").mkdir()
    other = tmp_path / "notes" / "a" / "b" / "c"
    other.mkdir(parents=True)
    results = read_results(tmp_path)
    place = f"intersection/{ALONE}"
    assert set(results.problems) == {
        f"dqn/{place}/seed_1/episodes.parquet",
        f"maac/{place}/seed_1/episodes.parquet",
        f"a2c/{place}/seed_1",
        f"a2c/{place}/seed_2",
        f"dqn/{place}/seed_2",
    }
    assert "algorithm is 'ppo', not 'maac'" in results.problems[f"maac/{place}/seed_1/episodes.parquet"]
    assert "run.json" in results.problems[f"a2c/{place}/seed_1"]
    assert [run.algorithm for run in results.finished] == ["ppo"]
    assert [run.status for run in results.runs if run.algorithm == "dqn"] == [UNREADABLE, NOT_BEGUN]


@pytest.mark.parametrize(
    ("episodes", "modes", "fits"),
    [
        (2, ["greedy"], True),
        (5, ["greedy"], False),
        (1, ["greedy"], False),
        (2, ["greedy", "sampled"], False),
        (2, ["sampled"], False),
    ],
)
def test_the_table_of_another_test_is_named(tmp_path, episodes, modes, fits):
    write_experiment(tmp_path)
    run = write_run(tmp_path, "ppo", greedy([*TWO, ["invalid", "invalid"]]))
    facts = json.loads((run / "run.json").read_text())
    tested = {"episodes": episodes, "modes": modes, "held_out_episodes": 0}
    (run / "run.json").write_text(json.dumps({**facts, "tested": tested}))
    results = read_results(tmp_path)
    assert len(results.finished) == fits
    said = results.problems.get(f"ppo/intersection/{ALONE}/seed_1/episodes.parquet", "")
    assert ("of another test" in said) is not fits


@pytest.mark.parametrize(("measured", "fits"), [(2, False), (3, True)])
def test_episodes_without_agents_belong_to_the_test(tmp_path, measured, fits):
    (table,) = greedy(TWO)
    table.attrs["episodes"]["measured"] = measured
    write_experiment(tmp_path)
    run = write_run(tmp_path, "ppo", [table], environment={"learn_in_bubbles": True})
    facts = json.loads((run / "run.json").read_text())
    tested = {"episodes": 3, "modes": ["greedy"], "held_out_episodes": 0}
    (run / "run.json").write_text(json.dumps({**facts, "tested": tested}))
    assert len(read_results(tmp_path).finished) == fits


@pytest.mark.parametrize(("lost", "fits"), [(0, True), (3, False)])
def test_agents_in_one_mode_tell_rows_that_another_has_lost(tmp_path, lost, fits):
    """Four of five episodes have agents; three of the greedy ones are lost."""
    four = [["goal", "goal"]] * 4
    tables = [agent_episodes(four[lost:], mode="greedy"), agent_episodes(four, mode="sampled")]
    tables[0].attrs["episodes"]["measured"] = tables[1].attrs["episodes"]["measured"] = 5
    write_experiment(tmp_path)
    run = write_run(tmp_path, "ppo", tables, environment={"learn_in_bubbles": True})
    facts = json.loads((run / "run.json").read_text())
    tested = {"episodes": 5, "modes": ["greedy", "sampled"], "held_out_episodes": 0}
    (run / "run.json").write_text(json.dumps({**facts, "tested": tested}))
    results = read_results(tmp_path)
    assert len(results.finished) == fits
    assert ("it holds 1 greedy episodes" in "".join(results.problems.values())) is not fits


@pytest.mark.parametrize(
    ("lost", "said"),
    [
        ({}, ""),
        ({"is_invalid": True}, "rows of 0 of its 1 invalid episodes"),
        ({"world": 2_000_001, "split": "train"}, "rows of 3 of its 4 measured episodes"),
        ({"split": "held_out"}, "rows of 2 of its 4 measured episodes"),
    ],
)
def test_a_table_that_has_lost_rows_is_named(tmp_path, lost, said):
    held_out = agent_episodes(TWO, mode="greedy", split="held_out", variation="dense")
    write_experiment(tmp_path)
    run = write_run(tmp_path, "ppo", [*greedy([*TWO, ["invalid", "invalid"]]), held_out])
    facts = json.loads((run / "run.json").read_text())
    tested = {"episodes": 2, "modes": ["greedy"], "held_out_episodes": 2}
    (run / "run.json").write_text(json.dumps({**facts, "tested": tested}))
    table = read_table(run / "episodes.parquet")
    is_lost = (table[[*lost]] == pd.Series(lost)).all(axis=1) if lost else table["agents"] < 0
    write_table(table[~is_lost], run / "episodes.parquet")
    problems = "".join(read_results(tmp_path).problems.values())
    assert said in problems
    assert bool(problems) is bool(said)


def test_the_number_of_held_out_episodes_is_checked(tmp_path):
    write_experiment(tmp_path)
    held_out = agent_episodes(TWO, mode="greedy", split="held_out", variation="dense")
    run = write_run(tmp_path, "ppo", [*greedy(), held_out])
    facts = json.loads((run / "run.json").read_text())
    tested = {"episodes": 2, "modes": ["greedy"], "held_out_episodes": 3}
    (run / "run.json").write_text(json.dumps({**facts, "tested": tested}))
    (said,) = read_results(tmp_path).problems.values()
    assert "it holds 2 greedy intersection@dense episodes, the run was tested on 3" in said


def test_unreadable_episodes_of_one_name_are_counted_by_run(tmp_path):
    write_experiment(tmp_path, seeds=[1, 2])
    for seed in (1, 2):
        (table,) = greedy()
        table.attrs["episodes"]["corrupted"] = {"seed42-world0100003-episode0": "half a file"}
        write_run(tmp_path, "ppo", [table], seed=seed)
    results = read_results(tmp_path)
    assert "2 episodes that cannot be read: discarded." in totals(results)
    assert f"episode ppo/intersection/{ALONE}/seed_1: seed42-world0100003-episode0" in dict(gaps(results))


def test_without_a_whole_file_of_commands_the_runs_count(tmp_path):
    write_run(tmp_path, "ppo", greedy())
    assert "missing" in read_results(tmp_path).problems["command.json"]
    write_experiment(tmp_path, algorithms=["pppo"])
    results = read_results(tmp_path)
    assert "did you mean 'ppo'" in results.problems["command.json, part 1"]
    assert results.commands == ("smarts-bench run hand.yaml",)
    assert [str(run) for run in results.finished] == [f"ppo, intersection, {ALONE}, seed 1"]


def test_each_part_that_cannot_be_read_is_named_and_the_name_is_of_none_before(tmp_path):
    root = tmp_path / "here"
    write_experiment(root, name="before")
    content = json.loads((root / "command.json").read_text())
    (part,) = content["parts"]
    wrong = [{"command": f"run {name}", "experiment": {"algorithms": [name]}} for name in ("pppo", "dqnn")]
    (root / "command.json").write_text(json.dumps({**content, "parts": [part, *wrong]}))
    results = read_results(root)
    assert (results.name, results.description) == ("here", "")
    assert [*results.problems] == ["command.json, part 2", "command.json, part 3"]
    assert all(said.endswith("correct or remove that part") for said in results.problems.values())
    assert [run.algorithm for run in results.runs] == ["ppo"]


def test_runs_of_a_scenario_that_has_moved_are_listed(tmp_path):
    task = {"name": "intersection", "scenarios": [str(tmp_path / "gone")]}
    write_experiment(tmp_path, tasks=[task], seeds=[1, 2, 3])
    write_run(tmp_path, "ppo", greedy())
    results = read_results(tmp_path)
    assert (len(results.finished), len(results.runs)) == (1, 3)
    assert not results.problems
    assert results.description == "Made by hand."


def test_no_results(tmp_path):
    with raises(ResultsError, tmp_path / "nowhere"):
        read_results(tmp_path / "nowhere")
    with raises(ResultsError, tmp_path):
        read_results(tmp_path)


def test_void_episodes_are_counted(tmp_path):
    write_experiment(tmp_path)
    write_run(tmp_path, "ppo", greedy([*TWO, ["invalid", "invalid"]]))
    counts = read_results(tmp_path).counts
    assert (counts["measured"], counts["invalid"]) == (2, 1)
