"""Experiment files: what they say, their runs, and that what is published about them is up to date."""

import json
from pathlib import Path

import pytest

from algorithms import settings as algorithm_settings
from benchmark.experiment import schema
from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import cells_of, references_of, runs_of
from smarts.config import ConfigError

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture
def write(tmp_path):
    def write(text):
        file = tmp_path / "mine.yaml"
        file.write_text(text)
        return file

    return write


def said(file, *overrides):
    with pytest.raises(ConfigError) as caught:
        read_experiment(file, overrides)
    return str(caught.value)


@pytest.mark.parametrize("file", sorted(CONFIGS.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_config_of_the_repository_can_be_read(file):
    experiment = read_experiment(file)
    assert experiment.name == file.stem
    assert len({run.folder for run in runs_of(experiment)}) == len([*runs_of(experiment)])


def test_every_algorithm_x_task_x_traffic_x_seed_is_a_run(write):
    file = write(
        "algorithms: [ppo, dqn]\ntasks: [loop, {name: both, scenarios: [loop, city]}]\nseeds: [1, 2, 5]\n"
    )
    experiment = read_experiment(file, ["reference=[parked]"])
    runs = [*runs_of(experiment)]
    assert len(runs) == 2 * 2 * 2 * 3
    assert [run.seed for run in runs[:8]] == [1] * 8  # the first seed of everything comes first
    assert {str(run.folder) for run in runs if run.seed == 5 and run.algorithm == "dqn"} == {
        f"dqn/{task}/{traffic}/seed_5"
        for task in ("loop", "both")
        for traffic in ("no_social_vehicles", "random_social_vehicles")
    }
    assert [cell.task.scenarios for cell in cells_of(experiment)][:2] == [("loop",), ("loop", "city")]
    assert len(references_of(experiment)) == 4


def test_settings_of_one_algorithm_go_before_those_of_all(write):
    file = write(
        "algorithms: [ppo, dqn]\ntasks: [loop]\ntraining: {lr: 0.1, epochs: 3, sharing: all}\n"
        "settings: {ppo: {lr: 0.2}}\n"
    )
    experiment = read_experiment(file)
    assert experiment.settings_of("ppo") == {"lr": 0.2, "epochs": 3, "sharing": "all"}
    assert experiment.settings_of("dqn") == {"lr": 0.1, "sharing": "all"}  # has no epochs


def test_the_digest_follows_what_training_depends_on_and_nothing_else(write):
    file = write("algorithms: [ppo]\ntasks: [loop]\n")

    def digest(*overrides):
        return next(runs_of(read_experiment(file, overrides))).digest()

    same = [["resources.parallel=1"], ["evaluation.episodes=5"], ["reference=[parked]"], ["name=other"]]
    other = [
        ["budget.agent_steps=5"],
        ["training.lr=1"],
        ["environment.agents=2"],
        ["seeds=[9]"],
        ["tasks=[city]"],
    ]
    assert {digest(*overrides) for overrides in same} == {digest()}
    assert len({digest(), *(digest(*overrides) for overrides in other)}) == 1 + len(other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("algorithms=[pppo]", "there is no algorithm 'pppo'; did you mean 'ppo'?"),
        ("tasks=[intersecton]", "there is no scenario 'intersecton'"),
        ("tasks=[loop, loop]", "there twice"),
        ("seeds=[]", "at least 1 item"),
        ("seeds=[-1]", "greater than or equal to 0"),
        ("budget.agent_steps=0", "greater than or equal to 1"),
        ("budget.minutes=-3", "greater than 0"),
        ("training.lrr=1", "there is no key training.lrr; did you mean 'lr'?"),
        ("settings.dqn.epochs=1", "there is no key settings.dqn.epochs"),
        ("settings.dqm.lr=1", "there is no key settings.dqm"),
        ("training.epochs=1", ""),
        ("training.tau=0.1", "none of the algorithms has tau"),
        ("training.epochs=1.5", "valid integer"),
        ("evaluation.modes=[greedily]", "'greedy' or 'sampled'"),
        ("reference=[parkt]", "did you mean 'parked'?"),
        ("name=../x", "cannot name a folder"),
    ],
)
def test_mistakes_are_named(write, change, message):
    file = write("algorithms: [ppo]\ntasks: [loop]\n")
    if message:
        assert message in said(file, change)
    else:
        read_experiment(file, [change])


def test_the_table_of_settings_is_up_to_date():
    assert algorithm_settings.settings() == json.loads(json.dumps(algorithm_settings.collect())), (
        "run python -m algorithms.settings"
    )


def test_the_schema_is_up_to_date():
    assert schema.FILE.read_text() == schema.text(), "run python -m benchmark.experiment.schema"
