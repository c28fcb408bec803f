"""`environment.time_limit` of experiments, and experiments of scripted policies alone."""

from contextlib import closing

import numpy as np
import pytest

from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import task_settings_of
from benchmark.running.environments import environment
from smarts.config import ConfigError
from smarts.types.actions import LaneAction

BASE = """algorithms: []
tasks: [loop]
traffic: [no_social_vehicles]
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        file = tmp_path / "mine.yaml"
        file.write_text(BASE + text)
        return read_experiment(file)

    return read


@pytest.mark.parametrize(("given", "ended"), [("", {}), (", time_limit: 1.5", {0: 15})])
def test_an_episode_ends_in_time(read, given, ended):
    # Three decisions of five steps.
    (setting,) = task_settings_of(read(f"scripted: [parked]\nenvironment: {{agents: 1{given}}}"))
    with closing(environment(setting, num_envs=1)) as env:
        env.reset(1)
        for _ in range(3):
            now = env.step([np.full((1, 1), LaneAction.keep_lane)])
    assert {row: metrics["steps"] for row, metrics in now.metrics.items()} == ended


@pytest.mark.parametrize("scripted", ["", "scripted: []"])
def test_an_experiment_of_nothing_is_refused(read, scripted):
    with pytest.raises(ConfigError, match="there is nothing to run"):
        read(scripted)
