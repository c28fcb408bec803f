"""The user code of docs/own_code.md works outside the repository, and its errors are named."""

import pytest

from benchmark.metrics import read_table
from benchmark.results.run_folder import RunFolder
from tests.blocks import ROOT, Page
from tests.commands import begin, finish

pytestmark = pytest.mark.slow

PAGE = ROOT / "docs" / "own_code.md"
RAISES = "    def __init__(self, *given, **named):\n        assert False\n\n"
ENGINE = """from smarts.providers.constant_speed import ConstantSpeed


class Steady(ConstantSpeed):
    pass
"""
ALGORITHM = "my_code.algorithm-MyConfig/loop/no_social_vehicles/seed_1"


@pytest.fixture
def folder(tmp_path):
    """Return a folder with the files of the page."""
    for _ in Page(PAGE, tmp_path).run():
        pass
    return tmp_path


def run(folder, *arguments):
    return finish(begin("run", str(folder / "mine.yaml"), "--out", str(folder / "results"), *arguments))


def test_the_page_trains_evaluates_and_reports(folder):
    code, _, err = run(folder)
    assert code == 0, err
    root = folder / "results" / "mine"
    report = (root / "report" / "report.md").read_text()
    for shown in ("my_code.algorithm-MyConfig", "my_code.driver-Hesitant", "Waiting", "Collision rate"):
        assert shown in report
    assert "Agility" not in report
    table = read_table(root / ALGORITHM / "episodes.parquet")
    assert {"standing", "on_the_road", "collisions", "goals"} <= {*table.columns}
    assert "agility" not in table.columns
    assert RunFolder(root / ALGORITHM).read_config()["algorithm"] == "my_code.algorithm:MyConfig"
    again = finish(begin("evaluate", str(root / ALGORITHM), "--episodes", "2", "--mode", "greedy"))
    assert again[0] == 0, again[2]
    assert "my_code.metric:WAITING" in again[1]
    sides = (str(root / name) for name in ("my_code.algorithm-MyConfig", "ppo"))
    compared = finish(begin("compare", *sides, "--metric", "my_code.metric:WAITING"))
    assert compared[0] == 0, compared[2]
    assert "my_code.metric:WAITING" in compared[1]
    page = folder / "board.html"
    listed = finish(begin("leaderboard", str(root), "--out", str(page)))
    assert listed[0] == 0, listed[2]
    assert "Waiting" in page.read_text()


def test_environment_runners_import_user_code(folder):
    (folder / "my_code" / "engine.py").write_text(ENGINE)
    changes = (
        "algorithms=['my_code.algorithm:MyConfig']",
        "scripted=[]",
        "resources.env_runners=1",
        "environment.traffic_engine=my_code.engine:Steady",
    )
    code, _, err = run(folder, *(part for change in changes for part in ("--set", change)))
    assert code == 0, err
    content = RunFolder(folder / "results" / "mine" / ALGORITHM).read_config()
    assert "my_code.engine:Steady" in content["own_code"]


def test_errors_in_environment_runners_are_named(folder):
    file = folder / "my_code" / "observation.py"
    late = "if world.step.max() > 40:\n                raise OSError('late')\n            "
    file.write_text(file.read_text().replace("rows, agents = np", f"{late}rows, agents = np"))
    changes = ("algorithms=[ppo]", "scripted=[]", "resources.env_runners=1")
    code, _, err = run(folder, *(part for change in changes for part in ("--set", change)))
    assert code == 1
    (message,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert f"{file}:{line_of(file, 'OSError')}" in message


def line_of(file, text):
    return next(number for number, line in enumerate(file.read_text().splitlines(), 1) if text in line)


def test_errors_during_training_end_only_that_run(folder):
    file = folder / "my_code" / "algorithm.py"
    file.write_text(file.read_text().replace("return loss +", "return 1 / 0 * loss +"))
    code, _, err = run(folder, "--set", "scripted=[]")
    assert code == 1
    (message,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert f"{file}:{line_of(file, '1 / 0')}" in message
    assert "ZeroDivisionError" in message
    assert "1 of 2 runs failed" in err
    assert RunFolder(folder / "results" / "mine" / "ppo/loop/no_social_vehicles/seed_1").status == "finished"


@pytest.mark.parametrize(
    ("name", "old", "new", "wrong"),
    [
        ("observation", "np.nonzero(observe_mask)", "np.nonzero()", "np.nonzero()"),
        ("observation", "    def bind", f"{RAISES}    def bind", "assert False"),
        ("reward", "step.speed", "step.sped", "step.sped"),
        ("metric", "episode.dt *", "episode.agents['no such column'] *", "no such column"),
    ],
)
def test_errors_in_the_first_decision_are_raised_before_ray_starts(folder, name, old, new, wrong):
    file = folder / "my_code" / f"{name}.py"
    file.write_text(file.read_text().replace(old, new))
    code, _, err = run(folder)
    assert code == 2
    (message,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert f"{file}:{line_of(file, wrong)}" in message
    assert not (folder / "results" / "mine").exists()
