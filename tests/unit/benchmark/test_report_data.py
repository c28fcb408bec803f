"""What a report reads: whole runs are used, everything else is named."""

from benchmark.results.reading import NOT_BEGUN, UNREADABLE, read_results
from tests.hand_made_results import ALONE, agent_episodes, write_experiment, write_run

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
    write_experiment(tmp_path, algorithms=["ppo", "dqn", "a2c"], seeds=[1, 2])
    write_run(tmp_path, "ppo", greedy())
    cut = write_run(tmp_path, "dqn", greedy()) / "episodes.parquet"
    cut.write_bytes(cut.read_bytes()[:-40])
    (write_run(tmp_path, "a2c", greedy()) / "run.json").write_text('{"status": "fini')
    (write_run(tmp_path, "a2c", greedy(), seed=2) / "config.yaml").write_text("a: [")
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


def test_without_a_whole_file_of_commands_the_runs_count(tmp_path):
    write_run(tmp_path, "ppo", greedy())
    assert "missing" in read_results(tmp_path).problems["command.json"]
    write_experiment(tmp_path, algorithms=["pppo"])
    results = read_results(tmp_path)
    assert "did you mean 'ppo'" in results.problems["command.json, part 1"]
    assert results.commands == ("smarts-bench run hand.yaml",)
    assert [str(run) for run in results.finished] == [f"ppo, intersection, {ALONE}, seed 1"]
