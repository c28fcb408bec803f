"""Results that something happened to: what is lost is named, and never counts as nought or as done."""

import numpy as np
import pandas as pd
import pytest

from benchmark.metrics import compare, compute, join_tables, write_table
from benchmark.results.files import ResultsError
from benchmark.results.progress import COLUMNS as PROGRESS_COLUMNS
from benchmark.results.progress import begin_progress
from benchmark.results.reading import NOT_BEGUN, UNREADABLE, read_results
from benchmark.results.run_folder import FINISHED, RunFolder
from tests.hand_made_results import ALONE, agent_episodes, write_experiment, write_run
from tests.raising import raises

PLACE = f"ppo/intersection/{ALONE}/seed_1"
CRASHES = [["collision", "goal"], ["collision", "collision"], ["goal", "goal"]]
"""3 of 6 agents collide, 3 arrive."""
TESTED = {"episodes": 3, "modes": ["greedy"], "held_out_episodes": 0}


def table_of(outcomes=CRASHES, **labels):
    return agent_episodes(outcomes, mode="greedy", **labels)


def finished(root, change=lambda table: table) -> RunFolder:
    """Write a finished run whose table was changed, and return its folder."""
    write_experiment(root)
    folder = RunFolder(write_run(root, "ppo", [table_of()]))
    folder.note(status=FINISHED, tested=TESTED)
    changed = change(pd.read_parquet(folder.table))
    changed.attrs = table_of().attrs
    write_table(changed, folder.table)
    return folder


def test_a_table_of_another_run_counts_for_none(tmp_path):
    finished(tmp_path, lambda table: table.assign(algorithm="dqn"))
    results = read_results(tmp_path)
    assert not results.finished
    assert "of another run" in results.problems[f"{PLACE}/episodes.parquet"]


def test_a_metric_that_a_table_has_no_numbers_of_is_not_available(tmp_path):
    finished(tmp_path, lambda table: table.assign(overtakes=table["overtakes"].where(table.index != 2)))
    results = read_results(tmp_path)
    assert len(results.finished) == 1
    row = compute(results.table, ["algorithm"], ["competitive"]).iloc[0]
    assert np.isnan(row["value"])
    assert row["note"] == "n/a: not every table has numbers in column 'overtakes'"


def test_what_one_of_several_tables_lacks_is_not_nought():
    whole = table_of(algorithm="ppo", training_seed=1)
    part = table_of(algorithm="maddpg", training_seed=1).drop(columns=["collisions", "safe_decisions"])
    part.attrs = whole.attrs
    table = join_tables([whole, part])
    found = compute(table, ["algorithm"], ["collision_rate", "completion_rate", "safety"])
    values = found.set_index(["algorithm", "metric"])["value"]
    assert values["ppo", "collision_rate"] == 0.5
    assert values["maddpg", "completion_rate"] == 0.5
    assert np.isnan(values["maddpg", "collision_rate"])
    # One of its terms is the collision rate.
    assert np.isnan(values["maddpg", "safety"])
    differing = compare(table, ["collision_rate", "completion_rate"]).set_index("metric")
    assert differing.loc["collision_rate", "pairs"] == 0
    assert differing.loc["completion_rate", "pairs"] == 3


def test_a_table_that_is_damaged_is_named_and_one_that_is_lost_is_made_again(tmp_path):
    folder = finished(tmp_path)
    assert folder.is_finished(TESTED)
    folder.table.write_bytes(folder.table.read_bytes()[:2000])
    results = read_results(tmp_path)
    assert not results.finished
    assert "remove it" in results.problems[f"{PLACE}/episodes.parquet"]
    with raises(ResultsError, folder.table):
        folder.is_finished(TESTED)
    folder.checkpoint.mkdir()
    assert not folder.is_finished(TESTED)


def test_a_scripted_policy_needs_no_checkpoint_to_be_tested_again(tmp_path):
    folder = RunFolder(write_run(tmp_path, "parked", [agent_episodes(CRASHES, mode="scripted")], seed=-1))
    folder.note(status=FINISHED, tested=TESTED)
    assert folder.is_finished(TESTED)
    folder.table.unlink()
    assert not folder.is_finished(TESTED)


@pytest.mark.parametrize(("last", "said"), [(b"2,100", ""), (b"2,x,5.0,200,,,,,,\n", "damaged: ")])
def test_a_line_of_progress_that_was_cut_is_left_out_and_a_damaged_one_is_named(tmp_path, last, said):
    write_experiment(tmp_path)
    folder = RunFolder(write_run(tmp_path, "ppo", [table_of()]))
    folder.progress.write_bytes(",".join(PROGRESS_COLUMNS).encode() + b"\n1,500,2.5,200,,,,,,\n" + last)
    results = read_results(tmp_path)
    (run,) = results.finished
    if not said:
        assert run.progress[["agent_steps", "seconds"]].to_numpy().tolist() == [[500, 2.5]]
        assert not results.problems
        assert [line["iteration"] for line in begin_progress(folder.progress, 2)] == [1]
        return
    assert said in results.problems[f"{PLACE}/progress.csv"]
    with raises(ResultsError, folder.progress) as caught:
        begin_progress(folder.progress, 2)
    assert "remove it" in caught.value.remedy


def test_runs_that_are_there_under_way_and_missing(tmp_path):
    write_experiment(tmp_path, seeds=[1, 2, 3], scripted=["parked"])
    write_run(tmp_path, "ppo", [table_of()], seed=1)
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
    assert len(results.table) == 6
    assert not results.problems


def test_damaged_and_foreign_files_are_named_and_left_out(tmp_path):
    write_experiment(tmp_path, algorithms=["ppo", "dqn", "a2c"], seeds=[1, 2])
    write_run(tmp_path, "ppo", [table_of()])
    cut = write_run(tmp_path, "dqn", [table_of()]) / "episodes.parquet"
    cut.write_bytes(cut.read_bytes()[:-40])
    (write_run(tmp_path, "a2c", [table_of()]) / "run.json").write_text('{"status": "fini')
    (write_run(tmp_path, "a2c", [table_of()], seed=2) / "config.yaml").write_text("a: [")
    (tmp_path / "dqn" / "intersection" / ALONE / "seed_2").mkdir()
    other = tmp_path / "notes" / "a" / "b" / "c"
    other.mkdir(parents=True)
    results = read_results(tmp_path)
    place = f"intersection/{ALONE}"
    assert set(results.problems) == {
        f"dqn/{place}/seed_1/episodes.parquet",
        f"a2c/{place}/seed_1",
        f"a2c/{place}/seed_2",
        f"dqn/{place}/seed_2",
    }
    assert "run.json" in results.problems[f"a2c/{place}/seed_1"]
    assert [run.algorithm for run in results.finished] == ["ppo"]
    assert [run.status for run in results.runs if run.algorithm == "dqn"] == [UNREADABLE, NOT_BEGUN]
