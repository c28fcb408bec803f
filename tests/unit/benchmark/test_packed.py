"""Packed results are reported as they were in folders, and `run` does not repeat them."""

import pandas as pd
import pytest

from benchmark.experiment.config import read_experiment
from benchmark.report.comparing import read_side
from benchmark.report.content import make_report
from benchmark.report.robustness import robustness_of
from benchmark.results.files import ResultsError
from benchmark.results.reading import read_results
from benchmark.running.jobs import JobScheduler, jobs_of
from tests.hand_made_results import agent_episodes, finish_runs, pack, write_experiment, write_run
from tests.raising import raises
from tests.unit.benchmark import test_robustness_report

CONFIG = """
algorithms: [ppo]
tasks: [loop]
traffic: [no_social_vehicles]
seeds: [1, 2]
environment: {agents: 2}
budget: {agent_steps: 3000}
evaluation: {episodes: 2, modes: [greedy]}
"""
GREEDY = [["goal", "collision"], ["goal", "goal"]] * 10
root = test_robustness_report.root


def test_a_report_of_packed_runs_has_the_same_values(tmp_path):
    write_experiment(tmp_path / "runs", seeds=[1, 2], scripted=["parked"])
    for seed in (1, 2):
        tests = [
            agent_episodes(GREEDY, mode="greedy", stable_agents=1.0, stability=seed / 3),
            agent_episodes([["goal", "off_road"]], mode="greedy", split="held_out", variation="mirrored"),
        ]
        lines = [[1, 600, 5.0, 120, 0.25, 0.5, 0.1, "", "", ""], [2, 1000, 9.0, 111, *[""] * 6]]
        write_run(tmp_path / "runs", "ppo", tests, seed=seed, progress=lines)
    write_run(tmp_path / "runs", "parked", [agent_episodes([["not_moving"]], mode="scripted")], seed=-1)
    pack(tmp_path / "runs", tmp_path / "packed")
    before, after = (read_results(tmp_path / name) for name in ("runs", "packed"))
    assert [run.place for run in after.finished] == [run.place for run in before.finished]
    assert after.counts == before.counts
    assert not after.unfinished
    for one, other in zip(before.finished, after.finished, strict=True):
        assert (one.facts, one.config) == (other.facts, other.config)
        if one.progress is not None:
            pd.testing.assert_frame_equal(one.progress, other.progress)
    values = [make_report(results).values for results in (before, after)]
    pd.testing.assert_frame_equal(*values, rtol=1e-7)
    known = values[1].set_index(["algorithm", "metric"])["value"]
    assert known["ppo", "stability"] == pytest.approx(0.5)
    assert known["ppo", "completion_rate"] == 0.75
    for name in ("ppo", "scripted/parked"):
        assert {run.place for run in read_side(tmp_path / "packed" / name).runs} == {
            run.place for run in before.runs if run.place.startswith(name)
        }


def test_plays_that_are_packed_are_reported_alike(root, tmp_path_factory):
    out = tmp_path_factory.mktemp("packed")
    pack(root, out)
    before, after = (robustness_of(make_report(read_results(folder))) for folder in (root, out))
    assert len(before.values)
    pd.testing.assert_frame_equal(before.values, after.values)


def test_packed_runs_are_not_repeated_and_not_trained_on(tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text(CONFIG)
    experiment = read_experiment(file)
    folder = finish_runs(experiment, tmp_path / "runs", commit="abc")
    write_experiment(tmp_path / "runs")
    pack(tmp_path / "runs", tmp_path / "packed")

    def scheduler(*overrides):
        given = read_experiment(file, [*overrides])
        return JobScheduler(jobs_of(given), tmp_path / "packed", given.resources)

    assert folder.table.exists()
    assert scheduler().is_done
    assert [state.folder.facts()["commit"] for state in scheduler().states] == ["abc", "abc"]
    with raises(ResultsError, "seed_1", values=["checkpoint"]):
        scheduler("budget.agent_steps=4000")
    with pytest.raises(ResultsError, match="it was tested in another way"):
        scheduler("evaluation.episodes=3")
    assert [state.status for state in scheduler("seeds=[2,3]").states] == ["finished", "waiting"]
