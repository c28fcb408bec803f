"""Scenario files and maps that never come to an end."""

from smarts.errors import ScenarioError
from smarts.roads.children import TIME_LIMIT_VARIABLE
from smarts.sstudio.build import build_scenario
from tests.raising import raises


def test_scenario_files_that_never_end(scenario_folder, monkeypatch):
    monkeypatch.setenv(TIME_LIMIT_VARIABLE, "1")
    folder = scenario_folder("while True: pass")
    with raises(ScenarioError, values=["1 s"]) as caught:
        build_scenario(folder)
    assert caught.value.place == str(folder / "scenario.py")
    assert TIME_LIMIT_VARIABLE in caught.value.remedy
