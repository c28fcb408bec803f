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
        ("tune.parameters={lr: 3}", "tune.parameters.lr: 3 is not a search space; give a list"),
        ("tune.parameters={lr: []}", "[] is not a search space"),
        ("tune.parameters={lr: {normal: [0, 1]}}", "is not a search space"),
        ("tune.parameters={lr: {uniform: [1]}}", "is not a search space"),
        ("tune.parameters={lr: {uniform: [0, 1], randint: [0, 1]}}", "is not a search space"),
        ("tune.parameters={lr: {uniform: [a, b]}}", "tune.parameters.lr.uniform: ['a', 'b'] are not numbers"),
        (
            "tune.parameters={lr: {loguniform: [0, 1]}}",
            "[0, 1] are not bounds",
        ),
        ("tune.parameters={lr: {loguniform: [1, 0.1]}}", "[1, 0.1] are not bounds"),
        ("tune.parameters={lr: {uniform: [0, .inf]}}", "are not bounds"),
        ("tune.parameters={lr: {uniform: [1, 1]}}", "[1, 1] are not bounds"),
        ("tune.parameters={epochs: {randint: [1.5, 2.5]}}", "[1.5, 2.5] are not whole numbers"),
        ("tune.parameters={epochs: {uniform: [1, 5]}}", "epochs.uniform[0]: 1.0; "),
        ("tune.parameters={epochs: {randint: [0, 5]}}", "epochs.randint[0]: 0; "),
        ("tune.parameters={gamma: {uniform: [0.5, 1.5]}}", "gamma.uniform[1]: 1.5; "),
        ("tune.parameters={lr: [0.1, -1, a]}", "tune.parameters.lr[1]: -1; "),
        ("tune.parameters={lr: [0.1, -1, a]}", "tune.parameters.lr[2]: 'a'; "),
        ("tune.parameters={sharing: [allz]}", "tune.parameters.sharing[0]: 'allz'; "),
        ("tune.parameters={lr: {choice: []}}", "is not a search space"),
        ("tune.parameters={lr: {choice: 0.1}}", "is not a search space"),
        ("tune.parameters={lr: {choice: [0.1, 0.2], uniform: [0, 1]}}", "is not a search space"),
        ("tune.parameters={lr: {choice: [0.1, 0.2, -1]}}", "tune.parameters.lr.choice[2]: -1; "),
        ("tune.parameters={sharing: {choice: [allz]}}", "tune.parameters.sharing.choice[0]: 'allz'; "),
        ("tune.parameters={lrr: [1]}", "tune.parameters.lrr: 'ppo' has no such setting; did you mean 'lr'?"),
    ],
)
def test_mistakes_are_named(file, change, message):
    with pytest.raises(ConfigError) as caught:
        read_experiment(file, [change])
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
