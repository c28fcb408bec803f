"""Tests of finished runs that cannot be made, each refused with one message before anything starts."""

import pytest

from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import run_from, runs_of
from benchmark.results.files import ResultsError
from benchmark.results.run_folder import RunFolder
from benchmark.running.evaluating import Asked, asked_task, evaluate_checkpoint
from benchmark.running.policy import read_run
from benchmark.running.training import unpickled
from smarts.config import ConfigError
from tests.raising import raises


@pytest.fixture
def run(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("algorithms: [ppo]\ntasks: [loop]\nbudget: {minutes: 5}\n")
    return next(runs_of(read_experiment(file)))


@pytest.fixture
def folder(run, tmp_path):
    folder = RunFolder(tmp_path / "run")
    folder.open(run.content())
    return folder


def test_a_scenario_that_does_not_exist_is_one_message(folder):
    with pytest.raises(ConfigError, match=r"scenarios.0.: .*'intersecton'.* did you mean 'intersection'"):
        evaluate_checkpoint(folder.path, Asked(["intersecton"]))


def test_a_run_whose_scenario_does_not_exist_any_more(run, folder):
    assert run_from(run.content()).content() == run.content()
    folder.config.write_text(folder.config.read_text().replace("- loop", "- gone"))
    with pytest.raises(ResultsError) as caught:
        read_run(folder)
    assert "scenarios[0]: there is no scenario 'gone'" in caught.value.problem
    assert "pydantic" not in str(caught.value)


def test_an_evaluation_plays_the_conditions_of_the_runs_test(folder):
    test = [
        {"name": "a", "scenarios": ["roundabout"], "traffic": "dense"},
        {"name": "b", "scenarios": ["loop"]},
        {"name": "c", "scenarios": ["roundabout"], "traffic": "sparse"},
    ]
    folder.note(tested={"episodes": 9, "test": test})
    task = read_run(folder).task_setting.task
    assert [(each.name, each.scenarios, each.traffic) for each in task.test] == [
        ("a", ("roundabout",), "dense"),
        ("b", ("loop",), None),
        ("c", ("roundabout",), "sparse"),
    ]
    assert asked_task(task, [], None) == task
    for traffic, names in (("dense", ["a", "b (dense)"]), ("none", ["b (none)", "a (none)"])):
        asked = asked_task(task, [], traffic).test
        assert sorted((each.name, each.traffic) for each in asked) == sorted((name, None) for name in names)
    family = asked_task(task, ["intersections@test-*"], None)
    assert family.name == "intersections-test"
    assert len(family.trained_on) == 30
    alone = asked_task(task, ["city"], None)
    assert (alone.tested_on, alone.test) == (["city"], ())


def test_a_folder_that_is_not_there_leads_to_the_nearest(tmp_path):
    (tmp_path / "mf_ac_vehicles_1").mkdir()
    with raises(ResultsError, "mf_ac_vehicle_1") as caught:
        read_run(RunFolder(tmp_path / "mf_ac_vehicle_1"))
    assert "'mf_ac_vehicles_1'" in caught.value.remedy
    with raises(ResultsError, "nowhere") as caught:
        read_run(RunFolder(tmp_path / "not" / "nowhere"))
    assert "exported policy" in caught.value.remedy


@pytest.mark.parametrize(
    ("content", "said"), [(b"cno_such_module\nName\n.", "no_such_module"), (b"calgorithms.joint", "damaged")]
)
def test_a_checkpoint_that_cannot_be_read_is_named(tmp_path, content, said):
    file = tmp_path / "state.pkl"
    file.write_bytes(content)
    with raises(ResultsError, file, values=[said]):
        unpickled(file)
