"""`smarts-bench run` where nothing is left to do, so that neither Ray nor a simulation is needed."""

import signal

import pytest
import typer
from typer.testing import CliRunner

from benchmark.cli import Interruptible, app
from benchmark.cli.experiments import run
from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import runs_of
from benchmark.metrics import write_table
from benchmark.report import writing
from benchmark.results.run_folder import FINISHED, RunFolder
from benchmark.running.jobs import JobState, jobs_of
from benchmark.running.live import plan
from tests.hand_made_results import ALONE, agent_episodes

CONFIG = """
algorithms: [ppo]
tasks: [loop]
traffic: [no_social_vehicles]
seeds: [1, 2]
environment: {agents: 2}
budget: {agent_steps: 3000, minutes: 2}
evaluation: {episodes: 2, modes: [greedy]}
"""


@pytest.fixture
def file(tmp_path):
    """An experiment whose runs are all finished."""
    file = tmp_path / "done.yaml"
    file.write_text(CONFIG)
    for each in runs_of(read_experiment(file)):
        folder = RunFolder(tmp_path / "results" / "done" / each.folder)
        folder.open(each.content())
        folder.note(status=FINISHED, tested=each.task_setting.test_content())
        labels = {"algorithm": "ppo", "training_seed": each.seed, "task": "loop", "task_traffic": ALONE}
        outcomes = [["goal", "goal"], ["goal", "collision"]]
        write_table(agent_episodes(outcomes, mode="greedy", **labels), folder.table)
    return file


def test_a_finished_experiment_is_reported_again(file, tmp_path, capsys):
    with pytest.raises(typer.Exit) as ended:
        run(file, out=tmp_path / "results")
    page = tmp_path / "results" / "done" / "report" / "report.html"
    assert ended.value.exit_code == 0
    said = capsys.readouterr()
    first, *_ = said.err.splitlines()
    assert first == f"done: building scenarios, checking {page.parents[1]}"
    assert said.out.splitlines() == [f"results: {page.parents[1]}", f"report: {page}"]
    assert "PPO: 2 of 2 runs finished, 4 test episodes measured." in page.read_text()


def plan_of(experiment):
    states = [JobState(job) for job in jobs_of(experiment)]
    return plan(states, at_once=2)


def test_the_plan_names_the_budget_of_each_task(tmp_path):
    """A copy that clears what the file before it says of single tasks trains as long as it says."""
    (tmp_path / "base.yaml").write_text(
        f"{CONFIG}by_task: {{loop: {{budget: {{agent_steps: 9000}}}}}}\n".replace("[loop]", "[loop, u_turn]")
    )
    base = read_experiment(tmp_path / "base.yaml")
    begin = "plan: 4 trainings in 2 tasks, each of 9,000 agent-steps or 2 minutes, each of 3,000 agent-steps"
    assert plan_of(base).startswith(f"{begin} or 2 minutes, 8 test episodes, 2 at a time; ends about ")
    (tmp_path / "copy.yaml").write_text("extends: base.yaml\nbudget: {agent_steps: 400}\nby_task: {}\n")
    copy = read_experiment(tmp_path / "copy.yaml")
    assert copy.by_task == {}
    assert "each of 400 agent-steps or 2 minutes, 8 test episodes, 2 at a time" in plan_of(copy)


def test_sigterm_while_the_report_is_written_says_how_to_go_on(file, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(writing, "write_report", lambda root: signal.raise_signal(signal.SIGTERM))
    with pytest.raises(typer.Exit) as ended:
        run(file, out=tmp_path / "results")
    assert ended.value.exit_code == 130
    assert "give the same command again to resume" in capsys.readouterr().err


def test_ctrl_c_is_one_line_and_130():
    commands = typer.Typer(cls=Interruptible)

    @commands.callback()
    def group():
        pass

    @commands.command()
    def work():
        raise KeyboardInterrupt

    ended = CliRunner().invoke(commands, ["work"])
    assert (ended.exit_code, ended.stderr, ended.stdout) == (130, "interrupted\n", "")
    assert isinstance(typer.main.get_command(app), Interruptible)
