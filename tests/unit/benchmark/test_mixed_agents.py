"""Agents of an experiment that act and drive differently: `environment.agents` as a mapping."""

from contextlib import closing

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from algorithms.errors import SpaceError
from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import run_from, runs_of, with_defaults
from benchmark.running.environments import environment
from benchmark.running.experiment import check_task_settings
from smarts.config import ConfigError

MIXED = """
algorithms: [ppo]
tasks: [intersection]
traffic: [no_social_vehicles]
seeds: [1]
training: {sharing: all, rollout_fragment_length: 16}
environment:
  decision_interval: 5
  time_limit: 12
  vehicle_model: kinematic
  agents:
    car: {}
    truck: {vehicle: truck, action: Continuous}
    bus: {vehicle: bus, vehicle_model: bullet}
budget: {agent_steps: 3000}
evaluation: {episodes: 2, modes: [greedy], validations: 1, validation_episodes: 1, keep_episodes: true}
resources: {num_envs_per_env_runner: 2}
"""


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "mixed.yaml"
    file.write_text(MIXED)
    return file


def test_what_an_agent_does_not_say_is_the_environments(file):
    given = read_experiment(file).environment
    assert given.agent_count == 3
    assert {
        name: (each.vehicle, each.action, each.vehicle_model) for name, each in given.driving().items()
    } == {
        "car": ("generic_sedan", "Lane", "kinematic"),
        "truck": ("truck", "Continuous", "kinematic"),
        "bus": ("bus", "Lane", "bullet"),
    }


def test_a_run_with_them_is_recognised_by_its_content(file):
    content = next(runs_of(read_experiment(file))).content()
    assert content["environment"]["agents"]["truck"] == {"vehicle": "truck", "action": "Continuous"}
    assert content["environment"]["agents"]["car"] == {}
    again = run_from(content)
    assert with_defaults(again.content()) == with_defaults(content)
    assert again.task_setting.environment == read_experiment(file).environment


def test_the_environment_has_them_by_name(file):
    with closing(environment(next(runs_of(read_experiment(file))).task_setting, num_envs=1)) as env:
        blocks = {block.agents: block.action for block in env.spaces.blocks}
        assert [*blocks] == [("car", "bus"), ("truck",)]
        assert isinstance(blocks["car", "bus"], Discrete)
        assert isinstance(blocks["truck",], Box)
        env.reset(1)
        world = env._runner.world
        lengths = world.vehicles.length[0, world.agents.slot[0]]
        car, bus, truck = lengths.tolist()
        assert car < truck < bus
        env.step([np.zeros((1, 2), np.int64), np.zeros((1, 1, 3), np.float32)])


@pytest.mark.parametrize(
    ("change", "place", "value"),
    [
        ("car: {vehicel: bus}", "environment.agents.car.vehicel", "'vehicle'"),
        ("d: {}, e: {}", "environment.agents", "5 egos"),
    ],
)
def test_mistakes_are_named(file, change, place, value):
    with pytest.raises(ConfigError) as caught:
        read_experiment(file, [f"environment.agents={{{change}}}"])
    (problem,) = caught.value.problems
    assert place in problem.text
    assert value in f"{problem.text} {problem.remedy}"


@pytest.mark.parametrize(
    ("change", "place"),
    [("algorithms=[dqn]", "algorithms[0]"), ("training.sharing={x: [car, bus]}", "training.sharing")],
)
def test_what_cannot_act_as_all_of_them_is_refused(file, change, place):
    with pytest.raises(ConfigError) as caught:
        read_experiment(file, [change])
    (problem,) = caught.value.problems
    assert place in problem.text
    assert "truck" in problem.text


def test_groups_of_agents_with_different_spaces_are_refused_before_ray_starts(file):
    experiment = read_experiment(file, ["training.sharing={x: [car, truck], y: [bus]}"])
    with pytest.raises(SpaceError) as caught:
        check_task_settings(experiment)
    assert "'x'" in str(caught.value)
    assert "truck" in str(caught.value)
