"""`evaluate --out`: one evaluation in a folder, and nothing else lost; options that would have no effect."""

from contextlib import suppress

import pandas as pd
import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.cli.experiments import show_metrics
from benchmark.results.files import ResultsError, new_folder
from smarts.errors import SmartsError
from tests.hand_made_results import agent_episodes
from tests.raising import raises


def test_an_evaluation_is_in_its_folder_whole_or_not_at_all(tmp_path):
    out = tmp_path / "new"
    with suppress(KeyboardInterrupt), new_folder(out) as folder:
        (folder / "half").write_text("rows")
        raise KeyboardInterrupt
    assert not [*tmp_path.iterdir()]
    out.mkdir()
    with new_folder(out) as folder:
        (folder / "whole").write_text("rows")
    assert (out / "whole").read_text() == "rows"
    assert [*tmp_path.iterdir()] == [out]


def test_a_lost_connection_is_no_error_of_the_folder(tmp_path):
    with pytest.raises(ConnectionResetError), new_folder(tmp_path / "new"):
        raise ConnectionResetError


def test_folders_that_hold_something_are_refused_and_nothing_is_lost(tmp_path):
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    for place in (tmp_path, file):
        with raises(ResultsError, str(place)), new_folder(place):
            pass
    assert file.read_text() == "mine"


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
    assert isinstance(result.exception, SmartsError)
    assert result.exception.problem.startswith(named)


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
