"""`environment.traffic_step` of experiments: training gets it, validation and tests do not."""

from contextlib import closing

import pytest

from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import task_settings_of
from benchmark.running.environments import create, environment
from smarts.config import ConfigError

BASE = """algorithms: [ppo]
tasks: [{tasks}]
traffic: [{traffic}]
seeds: [1]
environment: {{agents: 1, {environment}}}
"""


@pytest.fixture
def read(tmp_path):
    def read(environment, tasks="two_way", traffic="random_social_vehicles"):
        file = tmp_path / "mine.yaml"
        file.write_text(BASE.format(environment=environment, tasks=tasks, traffic=traffic))
        return read_experiment(file)

    return read


def sumo_seconds(env):
    """Return how far SUMO is after the first of the world's steps, from the end of the warm-up [s]."""
    with closing(env):
        env.reset(1)
        (simulation,) = env._runner.simulation._stages.traffic._simulations
        time = simulation._library.simulation.getTime
        begin = time()
        simulation.step()
        return time() - begin


def test_training_has_the_longer_step_and_all_else_the_exact_one(read):
    (setting,) = task_settings_of(read("traffic_step: 0.5"))
    training = {"task_setting": setting, "num_envs": 1, "discount": None}
    assert sumo_seconds(create(training)) == pytest.approx(0.5)
    assert sumo_seconds(environment(setting, num_envs=1)) == pytest.approx(0.1)


@pytest.mark.parametrize(
    "given",
    [
        "traffic_step: 0.05",
        "traffic_step: 0.5, traffic_engine: ConstantSpeed",
        "traffic_step: 0.5, social_agents: [{agent: 'smarts.zoo:idm-v0'}]",
    ],
)
def test_mistakes_are_found_in_the_file(read, given):
    with pytest.raises(ConfigError) as error:
        read(given)
    assert any("environment.traffic_step" in str(problem) for problem in error.value.problems)


def test_a_scenario_with_bubbles_is_found_in_the_file(read):
    with pytest.raises(ConfigError) as error:
        read("traffic_step: 0.5", "examples/left_turn_bubble", "crossing")
    assert any("tasks[0]" in str(problem) for problem in error.value.problems)
