"""`evaluate --out`: one evaluation in a folder, and nothing else lost; options that would have no effect."""

from contextlib import suppress

import pandas as pd
import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.cli.experiments import show_metrics
from benchmark.results.files import ResultsError
from benchmark.results.run_folder import RunFolder
from benchmark.running.evaluation_folder import evaluation_folder
from tests.hand_made_results import agent_episodes
from tests.raising import raises

ONE = {"policy": "ppo, two_way", "scenarios": ["two_way"], "traffic": "none"}


def evaluated(out, what=ONE):
    """Write an evaluation's files."""
    with evaluation_folder(out, what) as folder:
        assert not folder.table.exists()
        folder.table.parent.mkdir(parents=True, exist_ok=True)
        folder.table.write_text("rows")
        (folder.episodes / "greedy-two_way").mkdir(parents=True)
    return RunFolder(out)


def test_the_same_evaluation_replaces_itself_and_leaves_other_files(tmp_path):
    out = tmp_path / "new"
    folder = evaluated(out)
    (out / "notes.txt").write_text("mine")
    (folder.episodes / "greedy-old").mkdir()
    evaluated(out)
    assert (out / "notes.txt").read_text() == "mine"
    assert not (folder.episodes / "greedy-old").exists()
    assert (folder.episodes / "greedy-two_way").exists()


def test_an_evaluation_that_fails_leaves_the_earlier_one(tmp_path):
    folder = evaluated(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    with suppress(KeyboardInterrupt), evaluation_folder(tmp_path, ONE) as again:
        again.episodes.mkdir(parents=True)
        again.table.write_text("half")
        raise KeyboardInterrupt
    assert folder.table.read_text() == "rows"
    assert sorted(tmp_path.rglob("*")) == before


def test_another_evaluation_is_refused_and_nothing_is_lost(tmp_path):
    folder = evaluated(tmp_path)
    for other in ({"traffic": "dense"}, {"policy": "dqn, two_way"}):
        (name,) = other
        with raises(ResultsError, str(tmp_path), values=[name, ONE[name]]):
            evaluated(tmp_path, ONE | other)
    assert folder.table.read_text() == "rows"


@pytest.mark.parametrize("name", ["notes.txt", "run.json"])
def test_folders_of_something_else_are_refused(tmp_path, name):
    (tmp_path / name).write_text("mine")
    with raises(ResultsError, str(tmp_path), values=[name]):
        evaluated(tmp_path)
    assert [each.name for each in tmp_path.iterdir()] == [name]
    with raises(ResultsError, str(tmp_path / name), values=[name]):
        evaluated(tmp_path / name)


@pytest.mark.parametrize(
    ("options", "named"),
    [(["--agent", "idm-v0", "--checkpoint", "last"], "--checkpoint")],
)
def test_options_without_effect_are_refused(tmp_path, options, named):
    policy = tmp_path / "policy"
    policy.mkdir()
    (policy / "policy.json").write_text("{}")
    places = {"RUN": str(tmp_path / "run"), "POLICY": str(policy)}
    result = CliRunner().invoke(app, ["evaluate", *(places.get(each, each) for each in options)])
    assert result.exit_code == 2
    assert f"Invalid value for {named}" in " ".join(result.output.split())


def test_each_of_several_scenarios_has_a_row(capsys):
    one = agent_episodes([["goal", "goal"], ["goal", "collision"]], mode="greedy", returns=1.0)
    two = agent_episodes([["collision", "collision"]], mode="greedy", task="loop", returns=1.0)
    show_metrics(one)
    assert "intersection: " not in capsys.readouterr().out
    show_metrics(pd.concat([one, two], ignore_index=True))
    rows = [line.strip() for line in capsys.readouterr().out.splitlines()]
    (first,) = [row for row in rows if row.startswith("intersection: ")]
    (second,) = [row for row in rows if row.startswith("loop: ")]
    assert "collision_rate 0.250" in first
    assert "completion_rate 0.750" in first
    assert "4 agent-episodes" in first
    assert "collision_rate 1.000" in second
    assert "2 agent-episodes" in second
