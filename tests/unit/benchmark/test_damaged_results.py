"""Results that something happened to: what is lost is named, and never counts as nought or as done."""

import json

import numpy as np
import pandas as pd
import pytest

from benchmark.metrics import compare, compute, join_tables, write_table
from benchmark.report.provenance import RUN_COLUMNS, run_rows
from benchmark.results.commands import keep_command, read_commands
from benchmark.results.files import ResultsError
from benchmark.results.progress import COLUMNS as PROGRESS_COLUMNS
from benchmark.results.progress import begin_progress
from benchmark.results.reading import read_results
from benchmark.results.run_folder import FINISHED, RunFolder
from tests.hand_made_results import ALONE, agent_episodes, write_experiment, write_run
from tests.raising import raises

PLACE = f"ppo/intersection/{ALONE}/seed_1"
CRASHES = [["collision", "goal"], ["collision", "collision"], ["goal", "goal"]]
"""3 of 6 agents collide, 3 arrive."""
TESTED = {"episodes": 3, "modes": ["greedy"], "held_out_episodes": 0}


def table_of(outcomes=CRASHES, **labels):
    return agent_episodes(outcomes, mode="greedy", **labels)


def with_counts(changed, table):
    changed.attrs = table.attrs
    return changed


def write_changed(root, change) -> RunFolder:
    """Write a finished run whose table was changed, and return its folder."""
    write_experiment(root)
    folder = RunFolder(write_run(root, "ppo", [table_of()]))
    folder.note(status=FINISHED, tested=TESTED)
    table = pd.read_parquet(folder.table)
    counts = table_of().attrs
    changed = change(table)
    changed.attrs = counts
    write_table(changed, folder.table)
    return folder


def lacking(name, rows=slice(None)):
    """Return a change that takes numbers of a column away."""

    def change(table):
        values = table[name].to_numpy(float).copy()
        values[rows] = np.nan
        return table.assign(**{name: values})

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda table: table.drop(columns="collisions"), "another version: it has no column 'collisions'"),
        (lambda table: table.drop(columns="agents"), "it has no column 'agents'"),
        (lacking("collisions"), "'collisions' is not a number in 6 of its 6 rows"),
        (lacking("goals", 2), "'goals' is not a number in 1 of its 6 rows"),
        (lambda table: table.assign(goals="many"), "'goals' is not of numbers"),
        (lambda table: table.assign(is_invalid="no"), "'is_invalid' is not of truth values"),
        (lambda table: table.assign(agents=2.0), "'agents' is not of 0 and 1"),
        (lambda table: table.iloc[:0], "holds no episodes"),
        (lambda table: pd.concat([table, table], ignore_index=True), "6 of its 12"),
    ],
)
def test_a_table_whose_numbers_cannot_be_is_neither_reported_nor_done(tmp_path, change, said):
    folder = write_changed(tmp_path, change)
    results = read_results(tmp_path)
    assert not results.finished
    assert said in results.problems[f"{PLACE}/episodes.parquet"]
    folder.checkpoint.mkdir()
    assert not folder.is_finished(TESTED)


def test_agents_that_took_no_part_need_no_numbers(tmp_path):
    def change(table):
        return lacking("collisions", 0)(lacking("agents", 0)(table).fillna({"agents": 0.0}))

    folder = write_changed(tmp_path, change)
    assert len(read_results(tmp_path).finished) == 1
    assert folder.is_finished(TESTED)


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.drop(columns="overtakes"),
        lacking("overtakes"),
        lacking("overtakes", 2),
        lambda table: table.assign(overtakes=np.inf),
    ],
)
def test_a_metric_that_a_table_has_no_numbers_of_is_not_available(tmp_path, change):
    write_changed(tmp_path, change)
    results = read_results(tmp_path)
    assert len(results.finished) == 1
    row = compute(results.table, ["algorithm"], ["competitive"]).iloc[0]
    assert np.isnan(row["value"])
    assert row["note"] == "n/a: not every table has numbers in column 'overtakes'"


def test_what_one_of_several_tables_lacks_is_not_nought():
    whole = table_of(algorithm="ppo", training_seed=1)
    part = with_counts(
        table_of(algorithm="maddpg", training_seed=1).drop(columns=["collisions", "safe_decisions"]), whole
    )
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


@pytest.mark.parametrize("left", [0, 2000])
def test_a_table_that_is_cut_is_tested_again_from_the_checkpoint(tmp_path, left):
    folder = write_changed(tmp_path, lambda table: table)
    assert folder.is_finished(TESTED)
    folder.table.write_bytes(folder.table.read_bytes()[:left])
    with raises(ResultsError, folder.table):
        folder.is_finished(TESTED)
    folder.checkpoint.mkdir()
    assert not folder.is_finished(TESTED)
    assert {*read_results(tmp_path).problems} == {f"{PLACE}/episodes.parquet"}


def test_a_run_without_a_checkpoint_is_not_trained_anew_for_another_test(tmp_path):
    folder = write_changed(tmp_path, lambda table: table)
    other = {**TESTED, "episodes": 7}
    with raises(ResultsError, folder.table, values=[TESTED]):
        folder.is_finished(other)
    folder.checkpoint.mkdir()
    assert not folder.is_finished(other)


def test_a_reference_needs_no_checkpoint_to_be_tested_again(tmp_path):
    folder = RunFolder(write_run(tmp_path, "parked", [agent_episodes(CRASHES, mode="scripted")], seed=-1))
    folder.note(status=FINISHED, tested=TESTED)
    assert folder.is_finished(TESTED)
    folder.table.write_bytes(b"")
    assert not folder.is_finished(TESTED)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("test_seconds", float("nan")),
        ("test_seconds", float("inf")),
        ("test_seconds", "long"),
        ("continued", 5),
        ("continued", ["a"]),
        ("tested", {"episodes": 3, "modes": 5}),
    ],
)
def test_a_fact_that_cannot_be_is_named(tmp_path, name, value):
    write_experiment(tmp_path)
    folder = RunFolder(write_run(tmp_path, "ppo", [table_of()]))
    facts = json.loads(folder.run.read_text())
    folder.run.write_text(json.dumps({**facts, name: value}))
    results = read_results(tmp_path)
    assert f"run.json: damaged: {name}" in results.problems[PLACE]
    assert not results.finished


@pytest.mark.parametrize("value", ["x", "", "inf"])
def test_a_line_of_progress_that_cannot_be_is_named(tmp_path, value):
    lines = [[1, 500, 2.5, 200, *[""] * 6], [2, 1000, value, 200, *[""] * 6]]
    write_experiment(tmp_path)
    folder = RunFolder(write_run(tmp_path, "ppo", [table_of()], progress=lines))
    results = read_results(tmp_path)
    assert [*results.problems] == [f"{PLACE}/progress.csv"]
    assert f"line 3, seconds is {value!r}" in results.problems[f"{PLACE}/progress.csv"]
    assert len(results.finished) == 1
    assert results.finished[0].progress["agent_steps"].tolist() == [500]
    # Not those of half the training.
    row = dict(zip(RUN_COLUMNS, run_rows(results)[0], strict=True))
    assert (row["agent-steps"], row["training"]) == ("", "")
    with raises(ResultsError, folder.progress):
        begin_progress(folder.progress, 2)


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        ("1,500,2.5,200,,,,,,\n2,100", ""),
        ("1,500,2.5,200,,,,,,\n\0\0\0\0", ""),
        ("x,1,1,1,,,,,,\n1,500,2.5,200,,,,,,\n", "line 2, iteration is 'x'"),
        ("0,1,1\n1,500,2.5,200,,,,,,\n", "line 2, "),
        ("0,1,1,1,,,,,,,,,9\n1,500,2.5,200,,,,,,\n", "line 2, "),
    ],
)
def test_a_truncated_or_damaged_line_leaves_the_others(tmp_path, damaged, said):
    write_experiment(tmp_path)
    folder = RunFolder(write_run(tmp_path, "ppo", None))
    folder.progress.write_text(",".join(PROGRESS_COLUMNS) + "\n" + damaged)
    results = read_results(tmp_path)
    (run,) = [run for run in results.runs if run.place == PLACE]
    assert run.progress is not None
    assert run.progress[["agent_steps", "seconds"]].to_numpy().tolist() == [[500, 2.5]]
    problem = results.problems.get(f"{PLACE}/progress.csv", "")
    assert (said in problem) if said else problem == ""


@pytest.mark.parametrize(
    ("lines", "budget", "ended_by", "said"),
    [
        ([(1000, 10.0)], {"agent_steps": 1000, "minutes": None}, None, ""),
        ([(500, 60.0)], {"agent_steps": 1000, "minutes": 1.0}, "minutes", ""),
        ([(500, 59.99)], {"agent_steps": 1000, "minutes": 1.0}, None, ""),
        ([(500, 30.0)], {"agent_steps": 1000, "minutes": 1.0}, "minutes", "50% of the budget"),
        ([(500, 60.0)], {"agent_steps": 1000, "minutes": 1.0}, "agent_steps", "50% of the budget"),
        ([(250, 5.0)], {"agent_steps": 1000, "minutes": None}, None, "ends at 250 agent-steps, 25% of"),
        ([], {"agent_steps": 1000, "minutes": None}, None, "missing or empty"),
    ],
)
def test_progress_that_ends_before_the_training_is_named(tmp_path, lines, budget, ended_by, said):
    write_experiment(tmp_path)
    rows = [[number, *each, 100, *[""] * 6] for number, each in enumerate(lines, start=1)]
    folder = RunFolder(write_run(tmp_path, "ppo", [table_of()], progress=rows, budget=budget))
    if ended_by:
        folder.note(ended_by=ended_by)
    if not lines:
        folder.progress.unlink()
    results = read_results(tmp_path)
    assert len(results.finished) == 1
    problem = results.problems.get(f"{PLACE}/progress.csv", "")
    assert (said in problem) if said else problem == ""
    row = dict(zip(RUN_COLUMNS, run_rows(results)[0], strict=True))
    assert (row["agent-steps"] == "") is bool(said)


@pytest.mark.parametrize("content", [b"1,2,3\n", b"\xff\xfe\n", ",".join(PROGRESS_COLUMNS).encode()[:20]])
def test_a_run_does_not_go_on_with_what_is_no_progress(tmp_path, content):
    folder = RunFolder(tmp_path)
    folder.progress.write_bytes(content)
    with raises(ResultsError, folder.progress) as caught:
        begin_progress(folder.progress, 3)
    assert "remove it" in caught.value.remedy
    assert folder.progress.read_bytes() == content


def test_a_config_of_something_else_is_named(tmp_path):
    write_experiment(tmp_path)
    folder = RunFolder(write_run(tmp_path, "ppo", [table_of()]))
    folder.config.write_text("{settings: 5, environment: [1]}")
    results = read_results(tmp_path)
    assert not results.finished
    assert "config.yaml: damaged: environment is [1]" in results.problems[PLACE]


@pytest.mark.parametrize("content", ["[]", "5"])
def test_a_run_file_without_keys_is_named(tmp_path, content):
    folder = RunFolder(tmp_path)
    folder.run.write_text(content)
    for look in (lambda: folder.check({}), lambda: folder.status):
        with raises(ResultsError, folder.run) as caught:
            look()
        assert "remove it" in caught.value.remedy


@pytest.mark.parametrize("content", ["[]", "5", '{"format": 2, "parts": 5}'])
def test_commands_that_are_none_are_named(tmp_path, content):
    write_experiment(tmp_path)
    _, (experiment,) = read_commands(tmp_path, {})
    (tmp_path / "command.json").write_text(content)
    with raises(ResultsError, "command.json") as caught:
        keep_command(tmp_path, experiment, "smarts-bench run hand.yaml")
    assert "remove it" in caught.value.remedy
