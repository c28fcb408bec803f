"""Searches: what the section `tune` of a file becomes, and what is refused before anything starts."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml
from ray import tune
from ray.tune.search.sample import Float, Integer

from benchmark.experiment.config import read_experiment
from benchmark.experiment.models import Tune
from benchmark.experiment.runs import runs_of
from benchmark.results.files import ResultsError
from benchmark.running.choosing import text_of, write_chosen
from benchmark.running.sweeping import (
    _check_same_search,
    _tuner,
    is_complete,
    scheduler_of,
    searched_runs,
    space_of,
    sweep,
    within_bounds,
)
from smarts.config import ConfigError
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


def test_lists_are_grids_and_draws_keep_their_bounds():
    section = Tune(
        parameters={
            "lr": {"loguniform": [1e-4, 1e-2]},
            "epochs": [1, 4],
            "minibatch_size": {"randint": [16, 64]},
            "hidden": {"choice": [[8], [8, 8], [64]]},
        }
    )
    space = space_of(section, "ppo")
    assert space["epochs"] == tune.grid_search([1, 4])
    assert isinstance(space["lr"], Float)
    assert (space["lr"].lower, space["lr"].upper) == (1e-4, 1e-2)
    assert isinstance(space["minibatch_size"], Integer)
    assert [*space["hidden"].categories] == [[8], [8, 8], [64]]
    draws = [space["lr"].sample() for _ in range(200)]
    assert 1e-4 <= min(draws) < 1e-3 < max(draws) <= 1e-2


def test_population_based_training_stays_within_bounds():
    parameters = {"gamma": {"uniform": [0.9, 0.99]}, "epochs": {"randint": [2, 5]}, "hidden": [[8], [16]]}
    parameters["sharing"] = {"choice": ["all", "none"]}
    section = Tune(parameters=parameters, scheduler="pbt")
    kept = {"hidden": [16], "sharing": "none", "lr": 7.0}
    given = {"gamma": 0.99 * 1.2, "epochs": 5, **kept}
    assert within_bounds(section, given) == {"gamma": 0.99, "epochs": 4, **kept}
    low = {"gamma": 0.9 * 0.8, "epochs": 1, "hidden": [8], "sharing": "all"}
    assert within_bounds(section, low) == {**low, "gamma": 0.9, "epochs": 2}
    explored = scheduler_of(section, "ppo", 5)._hyperparam_mutations
    assert explored["sharing"] == ["all", "none"]
    assert explored["hidden"] == [[8], [16]]


@pytest.mark.parametrize("setting", [None, 128, 1e-05, [[0, 0.001], [100000, 1e-05]], "128"])
def test_tables_of_trials_hold_settings_as_they_are(experiment, tmp_path, setting):
    table = pd.DataFrame({"lr": [text_of(setting), text_of(7)], "completion": [0.9, 0.1], "trial_id": "a"})
    table.to_csv(tmp_path / "trials.csv", index=False)
    section = Tune(parameters={"lr": [0.1]})
    for _ in range(2):  # the second time from the averages
        write_chosen(experiment(), section, [("ppo", tmp_path / "trials.csv")], tmp_path)
        content = yaml.safe_load((tmp_path / "chosen.yaml").read_text())
        assert content["settings"] == {"ppo": {"lr": setting}}


def test_a_search_in_a_scenario_that_has_changed_is_another(experiment, tmp_path):
    (run,) = searched_runs(experiment("tune={parameters: {lr: [0.1]}}"))
    section, file = Tune(parameters={"lr": [0.1]}), tmp_path / "search.json"
    _check_same_search(file, run, section)
    content = json.loads(file.read_text())
    (name,) = content["scenarios"]
    file.write_text(json.dumps(content | {"scenarios": {name: "other"}}))
    with raises(ResultsError, file, values=[f"scenarios.{name} (other, here "]):
        _check_same_search(file, run, section)


def test_a_search_is_complete_when_its_table_has_all_trials(tmp_path):
    section = Tune(
        parameters={"lr": [0.1, 0.2], "epochs": {"randint": [1, 4]}, "capacity": [1, 2]}, samples=3
    )
    whole = pd.DataFrame({"lr": 0.1, "completion": [0.5] * 6, "trial_id": "abc"})

    def is_whole(text):
        (tmp_path / "trials.csv").write_text(text)
        return is_complete(tmp_path, section, "ppo")  # which has no capacity

    assert not is_whole(whole.to_csv(index=False))  # of which search is not known
    (tmp_path / "search.json").write_text("{}")
    assert is_whole(whole.to_csv(index=False))
    failed, averages = whole.replace({"completion": {0.5: np.nan}}), whole.drop(columns="trial_id")
    for table in (whole[:5], failed, averages, whole.drop(columns="completion")):
        assert not is_whole(table.to_csv(index=False))


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        ([], "tune"),
        (["tune.parameters.lr=[0.1]", "seeds=[1, 2]"], "2 runs"),
        (["tune.parameters.lr=[0.1]", "evaluation.validations=0"], "evaluation.validations"),
        (["tune={parameters: {lr: [0.1]}, scheduler: asha}", "tasks=[loop, city]"], "tune.scheduler"),
        (["algorithms=[ppo, dqn]", "tune.parameters.epochs=[2]"], "'dqn' has none of the settings"),
        (["tune={parameters: {hidden: [[8], [16]]}, scheduler: pbt}"], "tune.parameters.hidden"),
        (["algorithms=[]", "scripted=[parked]", "tune.parameters={lr: [0.1]}"], "algorithms: [ppo]"),
    ],
)
def test_experiments_that_cannot_be_searched(experiment, tmp_path, overrides, named):
    with raises(SmartsError, values=[named]):
        sweep(experiment(*overrides), tmp_path / "results")
    assert not (tmp_path / "results").exists()


def test_a_search_that_was_stopped_before_its_first_trial_begins_again(experiment, tmp_path):
    """Tune restores its file of then without the settings to try."""
    (run,) = searched_runs(experiment("tune={parameters: {lr: [0.1]}}"))
    section = Tune(parameters={"lr": [0.1, 0.2]})
    space = space_of(section, run.algorithm)
    for _ in range(2):
        tuner = _tuner(run, section, space, tmp_path)
        assert tuner._local_tuner.get_run_config().name == "trials"
        assert tuner._local_tuner._param_space == space
        assert tune.Tuner.can_restore(str(tmp_path / "trials"))


def test_the_best_on_average_over_cells_is_chosen(experiment, tmp_path):
    """0.2 is best in either cell by itself for none: 0.9 and 0.0, 0.0 and 0.8, 0.5 and 0.6."""
    trials = {
        ("ppo", "one"): 'lr,hidden,completion\n0.1,[8],0.9\n0.2,"[8, 8]",0.5\n0.3,[8],0.0\n',
        ("ppo", "two"): 'lr,hidden,completion\n0.3,[8],0.8\n0.2,"[8, 8]",0.6\n0.1,[8],0.0\n',
        ("dqn", "one"): "lr,hidden,completion\n1e-05,[4],0.4\n0.2,[4],0.3\n",
        ("dqn", "two"): "lr,hidden,completion\n1e-05,[4],0.4\n0.2,[4],0.3\n",
    }
    tables = []
    for (algorithm, cell), text in trials.items():
        tables.append((algorithm, tmp_path / f"{algorithm}-{cell}.csv"))
        tables[-1][1].write_text(text)
    changes = ["algorithms=[ppo, dqn]", "tune.parameters={lr: [0.1], hidden: [[8]]}", "tasks=[loop, city]"]
    searched = experiment(*changes)
    write_chosen(searched, searched.tune, tables, tmp_path)
    means = pd.read_csv(tmp_path / "trials.csv").set_index(["algorithm", "lr"])["completion"].to_dict()
    assert means == pytest.approx(
        {("ppo", 0.1): 0.45, ("ppo", 0.2): 0.55, ("ppo", 0.3): 0.4, ("dqn", 1e-5): 0.4, ("dqn", 0.2): 0.3}
    )
    file = tmp_path / "mine.yaml"
    file.write_text("extends: chosen.yaml\ntasks: [double_merge]\nseeds: [1]\n")
    runs = {run.algorithm: run for run in runs_of(read_experiment(file))}
    assert runs["ppo"].settings == {"lr": 0.2, "hidden": [8, 8]}
    assert runs["dqn"].settings == {"lr": 1e-5, "hidden": [4]}
    assert runs["ppo"].task_setting.task.name == "double_merge"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("{lr: 3}", "tune.parameters.lr: 3 is not a search space; give a list"),
        ("{lr: {uniform: [0, 1], randint: [0, 1]}}", "is not a search space"),
        ("{lr: {loguniform: [0, 1]}}", "[0, 1] are not bounds of loguniform"),
        ("{epochs: {randint: [1.5, 2.5]}}", "[1.5, 2.5] are not bounds of randint; give two whole numbers"),
        ("{epochs: {randint: [0, 5]}}", "epochs.randint[0]: 0; "),
        ("{lr: [0.1, -1]}", "tune.parameters.lr[1]: -1; "),
        ("{lrr: [1]}", "tune.parameters.lrr: none of the algorithms has such a setting; did you mean 'lr'?"),
    ],
)
def test_mistakes_in_search_spaces_are_named(experiment, change, message):
    with pytest.raises(ConfigError) as caught:
        experiment(f"tune.parameters={change}")
    assert message in str(caught.value)
