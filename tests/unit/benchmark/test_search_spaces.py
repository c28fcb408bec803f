"""What searches may choose from is checked before training; mistakes are named with their place."""

import pytest

from benchmark.experiment.config import read_experiment
from smarts.config import ConfigError


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("algorithms: [ppo]\ntasks: [loop]\n")
    return file


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
def test_mistakes_are_named(file, change, message):
    with pytest.raises(ConfigError) as caught:
        read_experiment(file, [f"tune.parameters={change}"])
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "parameters",
    [
        {"lr": {"loguniform": [1e-5, 1]}, "gamma": {"uniform": [0, 1]}},
        {"epochs": {"randint": [1, 2]}, "hidden": [[8], [8, 8]]},
        {"epochs": {"choice": [1, 2, 9]}, "hidden": {"choice": [[8], [8, 8]]}},
    ],
)
def test_search_spaces_are_read_as_given(file, parameters):
    experiment = read_experiment(file, [f"tune.parameters={parameters}"])
    assert experiment.tune is not None
    assert experiment.tune.parameters == parameters
