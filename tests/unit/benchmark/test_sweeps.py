"""Searches: what the section `tune` of a file becomes, and what is refused before anything starts."""

import json
from dataclasses import replace

import pytest
from ray import tune
from ray.tune.schedulers import ASHAScheduler, PopulationBasedTraining
from ray.tune.search.sample import Float, Integer

from benchmark.experiment.config import Tune, read_experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.files import ResultsError
from benchmark.running.sweeping import (
    _check_same_search,
    scheduler_of,
    space_of,
    sweep,
    the_run,
    within_bounds,
)
from smarts.errors import SmartsError
from tests.raising import raises

ONE = "algorithms: [ppo]\ntasks: [loop]\ntraffic: [no_social_vehicles]\nseeds: [1]\n"


@pytest.fixture
def experiment(tmp_path):
    def read(*overrides):
        file = tmp_path / "search.yaml"
        file.write_text(ONE)
        return read_experiment(file, overrides)

    return read


def test_a_search_of_an_earlier_version_is_gone_on_with(experiment, tmp_path):
    """Its file lacks keys that have got defaults since."""
    file, section = tmp_path / "search.json", Tune(parameters={"lr": [0.1, 0.2]})
    (run,) = runs_of(experiment())
    _check_same_search(file, run, section)
    kept = json.loads(file.read_text())
    del kept["run"]["environment"]["decision_interval"]
    file.write_text(json.dumps(kept))
    _check_same_search(file, run, section)
    (other,) = runs_of(experiment("environment.decision_interval=3"))
    for changed in ((other, section), (run, Tune(parameters={"lr": [0.1, 0.3]}))):
        with pytest.raises(ResultsError) as caught:
            _check_same_search(file, *changed)
        assert caught.value.place == str(file)


def test_lists_are_grids_and_draws_keep_their_bounds():
    section = Tune(
        parameters={
            "lr": {"loguniform": [1e-4, 1e-2]},
            "epochs": [1, 4],
            "minibatch_size": {"randint": [16, 64]},
        }
    )
    space = space_of(section)
    assert space["epochs"] == tune.grid_search([1, 4])
    assert isinstance(space["lr"], Float)
    assert (space["lr"].lower, space["lr"].upper) == (1e-4, 1e-2)
    assert isinstance(space["minibatch_size"], Integer)
    draws = [space["lr"].sample() for _ in range(200)]
    assert 1e-4 <= min(draws) < 1e-3 < max(draws) <= 1e-2


def test_schedulers():
    parameters = {"lr": {"uniform": [0.1, 0.2]}}
    assert scheduler_of(Tune(parameters=parameters), 5) is None
    assert isinstance(scheduler_of(Tune(parameters=parameters, scheduler="asha"), 5), ASHAScheduler)
    assert isinstance(scheduler_of(Tune(parameters=parameters, scheduler="pbt"), 5), PopulationBasedTraining)


def test_population_based_training_stays_within_bounds():
    parameters = {"gamma": {"uniform": [0.9, 0.99]}, "epochs": {"randint": [2, 5]}, "hidden": [[8], [16]]}
    section = Tune(parameters=parameters, scheduler="pbt")
    given = {"gamma": 0.99 * 1.2, "epochs": 5, "hidden": [16], "lr": 7.0}
    assert within_bounds(section, given) == {"gamma": 0.99, "epochs": 4, "hidden": [16], "lr": 7.0}
    low = {"gamma": 0.9 * 0.8, "epochs": 1, "hidden": [8]}
    assert within_bounds(section, low) == {"gamma": 0.9, "epochs": 2, "hidden": [8]}


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        ([], "tune"),
        (["tune.parameters.lr=[0.1]", "seeds=[1, 2]"], "2 runs"),
        (["tune.parameters.lr=[0.1]", "evaluation.validations=0"], "evaluation.validations"),
        (["tune.parameters.lrr=[0.1]"], "tune.parameters.lrr"),
        (["tune.parameters.lr={normal: [0, 1]}"], "{'normal': [0, 1]}"),
        (["tune.parameters.lr=[0.1]", "traffic=[rush_hour]"], "rush_hour"),
    ],
)
def test_experiments_that_cannot_be_searched(experiment, tmp_path, overrides, named):
    with raises(SmartsError, values=[named]):
        sweep(experiment(*overrides), tmp_path / "results")
    assert not (tmp_path / "results").exists()


def test_one_run_is_searched(experiment):
    assert the_run(experiment()).algorithm == "ppo"


def test_a_search_continues_with_further_imports_only(experiment, tmp_path):
    run, section, file = the_run(experiment()), Tune(parameters={"lr": [0.1]}), tmp_path / "search.json"

    def importing(*paths):
        return replace(run, task_setting=replace(run.task_setting, imports=paths))

    _check_same_search(file, importing("/a/own.py"), section)
    _check_same_search(file, importing("/a/own.py", "/a/more.py"), section)
    for other, searched in (
        (importing("/b/own.py"), section),
        (replace(importing("/a/own.py"), seed=9), section),
        (importing("/a/own.py"), Tune(parameters={"lr": [0.2]})),
    ):
        with pytest.raises(ResultsError) as caught:
            _check_same_search(file, other, searched)
        assert caught.value.place == str(file)
