"""Experiments on clusters whose machines have only third-party packages, and which lose some of them."""

import json
import os
import shutil
import signal

import pytest
import yaml

from benchmark.metrics.table import read_table
from benchmark.results.progress import read_progress
from tests.clusters import ON_A_NODE, ROOT, Driver, eventually, nodes
from tests.commands import finish, wait_for

EXPERIMENT = """
name: far
imports: [own.py]
algorithms: [ppo]
tasks: [ring]
traffic: [no_social_vehicles]
seeds: [3]
training: {sharing: all, rollout_fragment_length: 16}
environment:
  agents: 2
  time_limit: 12
  reward: own:Reward
  social_agents: [{agent: "own:slow-v0"}]
  hosts: {"own:slow-v0": ray}
budget: {agent_steps: 10000}
evaluation: {episodes: 2, validations: 2, validation_episodes: 1, modes: [greedy], keep_episodes: true}
resources: {num_envs_per_env_runner: 2}
"""
OWN = f"""
import os

import numpy as np

import smarts
from smarts.agents import ActionSpaceType, AgentInterface
from smarts.agents.policy import BatchAgent
from smarts.zoo import register

if "{ON_A_NODE}" in os.environ:  # this project's code is shipped, too
    assert "working_dir_files" in smarts.__file__, smarts.__file__
    assert "working_dir_files" in __file__, __file__


class Reward:
    weights = "paper"

    def __call__(self, step):
        return 0.01 * step.speed


class Slow(BatchAgent):
    interface = AgentInterface(action=ActionSpaceType.Lane, vehicle_model="kinematic")
    observation = ("speed",)

    def act(self, batch):
        return np.zeros(len(batch.env_id), int)


register("slow-v0", Slow)
"""


@pytest.fixture
def driver(tmp_path):
    """A machine with an experiment, own code and a scenario of its own."""
    made = Driver(tmp_path)
    (made.content / "own.py").write_text(OWN)
    (made.content / "far.yaml").write_text(EXPERIMENT.replace("[ring]", f"[{made.folder}/ring]"))
    ignored = shutil.ignore_patterns("build", "__pycache__")
    shutil.copytree(ROOT / "scenarios" / "loop", made.content / "ring", ignore=ignored)
    return made


def begin(driver, cluster, *more):
    address = ("--set", f"resources.address='{cluster.address}'")
    return driver.begin(
        "run", driver.folder / "far.yaml", "--out", driver.folder / "results", *address, *more
    )


def folder_of(driver, seed=3):
    return driver.content / f"results/far/ppo/ring/no_social_vehicles/seed_{seed}"


def lines(run):
    return len(read_progress(run / "progress.csv"))


def check_finished(driver, run):
    """Check that a run's folder holds what it does on one machine."""
    assert json.loads((run / "run.json").read_text())["status"] == "finished"
    progress = read_progress(run / "progress.csv")
    assert progress["iteration"].tolist() == [*range(1, len(progress) + 1)]
    assert progress["agent_steps"].iloc[-1] >= 10000
    assert {each.name for each in run.iterdir()} == {
        *("best", "checkpoint", "config.yaml", "episodes", "episodes.parquet"),
        *("progress.csv", "run.json", "tensorboard"),
    }
    assert len(read_table(run / "episodes.parquet")) == 2 * 2
    assert len([*(run / "episodes" / "greedy-ring").glob("seed*")]) == 2
    config = yaml.safe_load((run / "config.yaml").read_text())
    assert config["scenarios"] == [f"{driver.folder}/ring"]
    assert config["imports"] == [f"{driver.folder}/own.py"]


def test_a_node_that_is_lost_costs_a_run_what_came_after_its_checkpoint(driver):
    with nodes(1, 1) as cluster:
        process = begin(driver, cluster, "--set", "seeds=[3, 4]")
        runs = [folder_of(driver, seed) for seed in (3, 4)]
        wait_for(lambda: all((run / "checkpoint").exists() for run in runs), process)
        assert [*cluster.workers("ray::_execute").values()].count(cluster.nodes[1]) == 1
        cluster.kill(cluster.nodes[1])
        code, _, err = finish(process)
        assert code == 0, err
        for run in runs:
            check_finished(driver, run)
        facts = [json.loads((run / "run.json").read_text()) for run in runs]
        assert sorted(len(each.get("continued", ())) for each in facts) == [0, 1]
        assert driver.is_hidden()
        eventually(lambda: not cluster.left_over())
        eventually(lambda: not cluster.workers("ray::_execute"))
        eventually(lambda: not cluster.workers("ray::_Actor"))


def runners(cluster):
    """Return the machines on which environments are sampled."""
    return [*cluster.workers("ray::ImportingRunner").values()]


@pytest.mark.nightly
def test_a_driver_and_an_env_runner_that_are_lost(driver):
    # None on the driver's node, one for the run, one for its runner, and one to spare.
    with nodes(0, 1, 1, 1) as cluster:
        run = folder_of(driver)
        # Long enough that a runner can be killed before the training has ended, also on a busy machine.
        settings = ("--set", "resources.env_runners=1", "--set", "budget.agent_steps=24000")
        process = begin(driver, cluster, *settings)
        wait_for((run / "checkpoint").exists, process)
        os.killpg(process.pid, signal.SIGKILL)
        finish(process)
        kept = json.loads((run / "checkpoint" / "training.json").read_text())["iteration"]
        assert lines(run) >= kept
        eventually(lambda: not cluster.workers("ray::_execute") and not cluster.workers("ray::Importing"))

        process = begin(driver, cluster, *settings)
        # The first command may have left lines after its checkpoint: runners say that the second one trains.
        wait_for(lambda: lines(run) > kept and runners(cluster), process)
        first = lines(run)
        cluster.kill(runners(cluster)[0])
        code, _, err = finish(process)
        assert code == 0, err
        assert first < lines(run)
        check_finished(driver, run)
        # By the second command; the run itself has lost nothing.
        assert len(json.loads((run / "run.json").read_text())["continued"]) == 1
        assert driver.is_hidden()
