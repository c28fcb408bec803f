"""`smarts-bench run` where nothing is left to do, so that neither Ray nor a simulation is needed."""

import pytest
import typer

from benchmark.cli.run import run
from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import runs_of
from benchmark.metrics import write_table
from benchmark.results.run_folder import FINISHED, RunFolder
from tests.hand_made_results import ALONE, agent_episodes

CONFIG = """
algorithms: [ppo]
tasks: [loop]
traffic: [no_social_vehicles]
seeds: [1, 2]
environment: {agents: 2}
evaluation: {episodes: 2, modes: [greedy]}
"""


def test_a_finished_experiment_is_reported_again(tmp_path, capsys):
    file = tmp_path / "done.yaml"
    file.write_text(CONFIG)
    for each in runs_of(read_experiment(file)):
        folder = RunFolder(tmp_path / "results" / "done" / each.folder)
        folder.open(each.content(), each.digest())
        folder.note(status=FINISHED, digest=each.digest(), tested=each.cell.test_content())
        labels = {"algorithm": "ppo", "training_seed": each.seed, "task": "loop", "task_traffic": ALONE}
        outcomes = [["goal", "goal"], ["goal", "collision"]]
        write_table(agent_episodes(outcomes, mode="greedy", **labels), folder.table)
    with pytest.raises(typer.Exit) as ended:
        run(file, out=tmp_path / "results")
    page = tmp_path / "results" / "done" / "report" / "report.html"
    assert ended.value.exit_code == 0
    assert capsys.readouterr().out.splitlines() == [f"results: {page.parents[1]}", f"report: {page}"]
    assert "2 of 2 runs are finished." in page.read_text()
