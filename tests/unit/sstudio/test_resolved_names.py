"""Names of scenarios that mean the same wherever they are read."""

import shutil

import pytest

from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import runs_of
from smarts.sstudio.locating import SUITE, locate, resolved


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A folder with a scenario and a map of its own, which is where commands are given."""
    shutil.copytree(SUITE / "loop", tmp_path / "mine", ignore=shutil.ignore_patterns("build"))
    (tmp_path / "road.osm").write_text("<osm/>")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_scenario_of_the_suite_has_its_name_and_others_their_path(mine, monkeypatch):
    variation = "@three_lanes"
    for given in ("loop", str(SUITE / "loop"), f"{SUITE}/../scenarios/loop/"):
        assert resolved(f"{given}{variation}") == f"loop{variation}"
    for given in ("mine", "./mine", "mine/", "mine/scenario.py", "elsewhere/../mine"):
        assert resolved(f"{given}{variation}") == f"{mine / 'mine'}{variation}"
    assert resolved(f"road.osm{variation}") == f"{mine / 'road.osm'}{variation}"
    found = locate(resolved(f"mine{variation}"))
    monkeypatch.chdir("elsewhere")
    assert locate(resolved(str(mine / f"mine{variation}"))) == found
    assert resolved(f"../mine{variation}") == f"{mine / 'mine'}{variation}"


def test_a_name_of_the_suite_means_a_folder_here_first(mine):
    assert resolved("loop") == "loop"
    (mine / "elsewhere").rename(mine / "loop")
    assert resolved("loop") == "loop", "a folder without a scenario"
    (mine / "loop").rmdir()
    (mine / "mine").rename(mine / "loop")
    assert resolved("loop") == str(mine / "loop")


def test_a_run_is_the_same_from_every_folder(mine, monkeypatch):
    file = mine / "e.yaml"
    file.write_text("algorithms: [ppo]\ntasks: [mine, loop]\n")

    def contents():
        return [run.content() for run in runs_of(read_experiment(file))]

    here = contents()
    assert [content["scenarios"] for content in here[:2]] == [[str(mine / "mine")], ["loop"]]
    monkeypatch.chdir("elsewhere")
    file.write_text("algorithms: [ppo]\ntasks: [../mine, loop]\n")
    assert contents() == here
