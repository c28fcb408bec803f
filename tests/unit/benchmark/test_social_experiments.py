"""Agents of the zoo, and learning in bubbles, in experiment files."""

from contextlib import closing

import pytest

from benchmark.experiment.config import read_experiment
from benchmark.experiment.environment import Environment
from benchmark.experiment.runs import task_settings_of, with_defaults
from benchmark.running.environments import environment
from benchmark.running.experiment import check_task_settings
from smarts.config import ConfigError

BASE = "algorithms: [ppo]\ntasks: [intersection]\ntraffic: [no_social_vehicles]\nseeds: [1]\n"
SOCIAL = """environment:
  agents: 1
  social_agents:
    - {agent: "smarts.zoo:idm-v0", count: 2, options: {tau: 1.5}}
"""
BUBBLE = """algorithms: [ppo]
tasks: [{name: left_turn, scenarios: [examples/left_turn_bubble]}]
traffic: [crossing]
environment: {agents: 3, learn_in_bubbles: [left-turn], episode_time: 20}
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        file = tmp_path / "mine.yaml"
        file.write_text(text)
        return read_experiment(file)

    return read


def test_social_agents_and_hosts_reach_the_environment(read):
    hosts = "  hosts: {idm-v0: {where: process, delay_steps: 3}}\n"
    experiment = read(BASE + SOCIAL.replace("smarts.zoo:idm-v0", "idm-v0") + hosts)
    check_task_settings(experiment)
    (setting,) = task_settings_of(experiment)
    with closing(environment(setting, num_envs=1)) as env:
        (policy,) = env._runner._requests._policies
        assert policy.start is not None
        assert policy.host.delay_steps == 3
        assert env.reset(1).alive.shape == (1, 1), "they are no learners"
        assert len(env.episodes[0].agents) == 3


def test_where_an_agent_acts_is_no_part_of_a_run_and_when_is():
    def kept(**host):
        return Environment(hosts={"idm-v0": host}).content()

    plain = Environment().content()
    assert kept(where="process") == plain == Environment(hosts={"*": "ray"}).content()
    late = kept(where="process", delay_steps=3)
    assert late["hosts"] == {"idm-v0": {"delay_steps": 3}}
    assert Environment(**late).content() == late
    assert with_defaults({"environment": late}) == {"environment": late}
    impatient = kept(where="process", patience=3.0)
    assert impatient["hosts"] == {"idm-v0": {"patience": 3.0}}
    assert Environment(**impatient).content() == impatient
    timely = kept(where="ray", deadline_ms=50.0)
    assert timely == kept(where="process", deadline_ms=50.0)
    assert timely["hosts"] == {"idm-v0": {"where": "process", "deadline_ms": 50.0}}
    assert Environment(**timely).content() == timely


@pytest.mark.parametrize(
    ("hosts", "count"),
    [
        ("{smarts.zoo:idm-v0: {deadline_ms: 20, delay_steps: 3}}", 1),
        ("{smarts.zoo:idm-v0: {where: process, patience: 0, delay: 3}, mobil-v0: ray}", 2),
    ],
)
def test_hosts_that_cannot_be_are_errors_of_the_file_once_each(read, hosts, count):
    with pytest.raises(ConfigError) as raised:
        read(BASE + SOCIAL + f"  hosts: {hosts}\n")
    assert len(raised.value.problems) == count
    assert all("union" not in str(each) and "literal[" not in str(each) for each in raised.value.problems)


def test_agents_that_learn_in_bubbles_reach_the_environment(read):
    experiment = read(BUBBLE)
    check_task_settings(experiment)
    (setting,) = task_settings_of(experiment)
    with closing(environment(setting, num_envs=1)) as env:
        env.reset(1)
        assert env.episodes[0].agents == ()
        assert env.episodes[0].bubbles[0].policy == -1


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ("social_agents: [{agent: 'smarts.zoo:nobody-v0'}]", "social_agents[0]"),
        ("social_agents: [{agent: 'smarts.zoo:idm-v0', options: {colour: red}}]", "social_agents[0]"),
        ("learn_in_bubbles: true", "episode_time"),
    ],
)
def test_mistakes_are_found_in_the_file(read, given, key):
    with pytest.raises(ConfigError) as error:
        read(f"{BASE}environment:\n  {given}\n")
    assert any(f"environment.{key}" in str(problem) for problem in error.value.problems)
