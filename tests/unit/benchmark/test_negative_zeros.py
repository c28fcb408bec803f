"""What rounds to zero is written without a sign, on the screen, on pages and in files."""

import re

import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.cli.experiments import show_metrics
from benchmark.report.leaderboard_page import write_leaderboard
from benchmark.report.values import Value, csv_number
from benchmark.report.writing import write_report
from benchmark.running.jobs import JobState
from benchmark.running.live import _numbers
from benchmark.running.messages import RunProgress
from tests.hand_made_results import agent_episodes, write_experiment, write_run

OUTCOMES = [["goal", "collision"], ["collision", "goal"]] * 6
NEGATIVE_ZERO = re.compile(r"(?<![\d.\w-])[-\u2212]0(\.0+)?(?![\d.\w-])")
TINY = -0.0001
"""Mean return, and difference of the mean returns."""


def episodes(returns):
    table = agent_episodes(OUTCOMES, mode="greedy").assign(returns=1.0)
    return table.assign(**{"return": [returns * (1 + row % 3) for row in range(len(table))]})


@pytest.fixture
def root(tmp_path):
    write_experiment(tmp_path / "one", algorithms=["ppo", "dqn"])
    write_run(tmp_path / "one", "ppo", [episodes(TINY)])
    write_run(tmp_path / "one", "dqn", [episodes(0.0)])
    return tmp_path / "one"


def test_the_pattern_finds_them():
    for text in ("-0.000", "[-0.00, +1.00]", "a,-0,b", "| -0.0 |", "\u22120.0"):
        assert NEGATIVE_ZERO.search(text)
    for text in ("-0.001", "+0.000", "seed-0", "2026-11-0", "1e-05", "-0.0x"):
        assert not NEGATIVE_ZERO.search(text)


def test_compare(root, tmp_path):
    table = tmp_path / "table.csv"
    arguments = ["compare", str(root / "ppo"), str(root / "dqn"), "--metric", "return", "--csv", str(table)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "+0.000" in done.output
    assert not NEGATIVE_ZERO.search(done.output + table.read_text())
    same = CliRunner().invoke(app, ["compare", str(root / "dqn"), str(root / "ppo"), "--csv", str(table)])
    assert same.exit_code == 0, same.output
    assert not NEGATIVE_ZERO.search(same.output + table.read_text())


def test_reports_and_leaderboards(root, tmp_path):
    page = write_report(root)
    write_leaderboard([root], tmp_path / "board.html", "greedy")
    texts = [
        path.read_text() for path in page.parent.iterdir() if path.suffix in (".md", ".csv", ".tex", ".html")
    ]
    assert len(texts) >= 5
    for text in (*texts, (tmp_path / "board.html").read_text()):
        words = re.sub(r"<(script|style|svg).*?</\1>", "", text, flags=re.DOTALL)
        assert not NEGATIVE_ZERO.search(words)


def test_evaluate(capsys):
    show_metrics(episodes(TINY))
    said = capsys.readouterr().out
    assert re.search(r"return +0\.000 ", said)
    assert re.search(r"goal_distance \[m\] ", said)
    assert not NEGATIVE_ZERO.search(said)


def test_single_numbers():
    value = Value("return", TINY, TINY, 1.0, 24, 24.0, "agent-episodes", 12, 1, "this checkpoint", "")
    assert (value.text, value.interval) == ("0.0", "[0.0, 1.0]")
    state = JobState("a run", "training")  # type: ignore[arg-type] - of a job only its name is shown
    state.progress = RunProgress("training", 0.5, 6, 1500, 60.0, 867.4, TINY, 0.75, 0.25)
    assert _numbers(state)["return"] == "0.00"
    assert [csv_number(number) for number in (-0.0, -1e-9, 0.125)] == ["0", "-1e-09", "0.125"]
