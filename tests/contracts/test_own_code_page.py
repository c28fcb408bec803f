"""The code of docs/guide/own_code.md and its tutorials works outside the repository; its errors are named."""

import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.metrics import read_table
from benchmark.results.run_folder import RunFolder
from tests.blocks import ROOT, Page, blocks_of
from tests.commands import begin, finish

PAGE = ROOT / "docs" / "guide" / "own_code.md"
TUTORIALS = [
    PAGE.parent / "tutorials" / f"{name}.md" for name in ("algorithm", "observation_and_reward", "metric")
]
ENGINE = """from smarts.providers.native.engine import Native


class Steady(Native):
    pass
"""
RUN = "loop/no_social_vehicles/seed_1"
MINE = f"own_algorithm-CautiousConfig/{RUN}"


@pytest.fixture
def folder(tmp_path):
    """Return a folder with the files of the page, and the modules of the tutorials that it names."""
    for _ in Page(PAGE, tmp_path).run():
        pass
    for block in (block for page in TUTORIALS for block in blocks_of(page) if block.title.endswith(".py")):
        (tmp_path / block.title.removeprefix("examples/")).write_text(block.text)
    return tmp_path


def run(folder, *changes):
    options = [part for change in changes for part in ("--set", change)]
    return finish(begin("run", str(folder / "mine.yaml"), "--out", str(folder / "results"), *options))


def line_of(file, text):
    return next(number for number, line in enumerate(file.read_text().splitlines(), 1) if text in line)


def message_of(err):
    """Return the only error of a command."""
    (message,) = [line for line in err.splitlines() if line.startswith("error: ")]
    return message


def test_the_page_trains_evaluates_and_reports(folder):
    """An environment runner imports the code, too."""
    (folder / "my_code" / "engine.py").write_text(ENGINE)
    code, _, err = run(
        folder,
        "resources.env_runners=1",
        "environment.traffic_engine=my_code.engine:Steady",
        "algorithms=[own_algorithm:CautiousConfig]",
    )
    assert code == 0, err
    root = folder / "results" / "mine"
    report = (root / "report" / "report.md").read_text()
    for shown in ("own_algorithm-CautiousConfig", "my_code.driver-Hesitant", "Hard brakes", "Collision rate"):
        assert shown in report
    assert "Agility" not in report
    table = read_table(root / MINE / "episodes.parquet")
    assert {"own_hard_brakes", "own_seconds", "collisions", "goals"} <= {*table.columns}
    assert "agility" not in table.columns
    content = RunFolder(root / MINE).read_config()
    assert content["algorithm"] == "own_algorithm:CautiousConfig"
    assert "my_code.engine:Steady" in content["own_code"]
    for command in (
        ["evaluate", str(root / MINE), "--episodes", "2", "--mode", "greedy"],
        ["leaderboard", str(root), "--out", str(folder / "board.html")],
    ):
        ended = CliRunner().invoke(app, command, catch_exceptions=False)
        assert ended.exit_code == 0, ended.stderr
    assert "Hard brakes" in (folder / "board.html").read_text()


@pytest.mark.nightly
def test_errors_during_training_end_only_that_run(folder):
    file = folder / "own_algorithm.py"
    file.write_text(file.read_text().replace("return loss +", "return 1 / 0 * loss +"))
    code, _, err = run(folder, "scripted=[]", "resources.parallel=1")
    assert code == 1
    assert f"{file}:{line_of(file, '1 / 0')}" in message_of(err)
    assert "ZeroDivisionError" in message_of(err)
    assert "1 of 2 runs failed" in err
    assert RunFolder(folder / "results" / "mine" / "ppo" / RUN).status == "finished"


def test_errors_in_the_first_decision_are_raised_before_ray_starts(folder):
    file = folder / "my_code" / "observation.py"
    file.write_text(file.read_text().replace("np.nonzero(observe_mask)", "np.nonzero()"))
    code, _, err = run(folder)
    assert code == 2
    assert f"{file}:{line_of(file, 'np.nonzero()')}" in message_of(err)
    assert not (folder / "results" / "mine").exists()
