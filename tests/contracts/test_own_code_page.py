"""The folder of docs/own_code.md, outside of the repository, and the mistakes that such code can have."""

import pytest

from benchmark.metrics import read_table
from benchmark.results.run_folder import RunFolder
from tests.blocks import ROOT, Page
from tests.commands import begin, finish

pytestmark = pytest.mark.slow

PAGE = ROOT / "docs" / "own_code.md"
RAISES = "    def __init__(self, *given, **named):\n        assert False\n\n"
ALGORITHM = "my_code.algorithm-MyConfig/loop/no_social_vehicles/seed_1"


@pytest.fixture
def folder(tmp_path):
    """The files of the page."""
    for _ in Page(PAGE, tmp_path).run():
        pass
    return tmp_path


def run(folder, *arguments):
    return finish(begin("run", str(folder / "mine.yaml"), "--out", str(folder / "results"), *arguments))


def test_the_page_trains_tests_and_reports(folder):
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


def test_runners_of_environments_import_it_too(folder):
    changes = ("algorithms=['my_code.algorithm:MyConfig']", "scripted=[]", "resources.env_runners=1")
    code, _, err = run(folder, *(part for change in changes for part in ("--set", change)))
    assert code == 0, err


def test_what_raises_in_a_runner_of_environments_is_named_too(folder):
    file = folder / "my_code" / "observation.py"
    late = "if world.step.max() > 40:\n                raise OSError('late')\n            "
    file.write_text(file.read_text().replace("rows, agents = np", f"{late}rows, agents = np"))
    changes = ("algorithms=[ppo]", "scripted=[]", "resources.env_runners=1")
    code, _, err = run(folder, *(part for change in changes for part in ("--set", change)))
    assert code == 1
    (said,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert f"{file}:{line_of(file, 'OSError')}" in said


def line_of(file, text):
    return next(number for number, line in enumerate(file.read_text().splitlines(), 1) if text in line)


def test_what_raises_in_mid_training_ends_that_run_only(folder):
    file = folder / "my_code" / "algorithm.py"
    file.write_text(file.read_text().replace("return loss +", "return 1 / 0 * loss +"))
    code, _, err = run(folder, "--set", "scripted=[]")
    assert code == 1
    (said,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert f"{file}:{line_of(file, '1 / 0')}" in said
    assert "ZeroDivisionError" in said
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
def test_what_raises_in_the_first_decision_is_said_before_ray_starts(folder, name, old, new, wrong):
    file = folder / "my_code" / f"{name}.py"
    file.write_text(file.read_text().replace(old, new))
    code, _, err = run(folder)
    assert code == 2
    (said,) = [line for line in err.splitlines() if line.startswith("error: ")]
    assert f"{file}:{line_of(file, wrong)}" in said
    assert not (folder / "results" / "mine").exists()
