"""A whole search through the command line: interrupted, gone on with, one trial at a time, ranked."""

import csv
import json
import os
import shutil
import signal

import pytest

from smarts.sstudio.locating import SUITE
from tests.commands import begin, finish, wait_for

# Starts of Ray and trainings, of which each has to load everything: minutes on a busy machine.
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3000)]

SEARCH = """
algorithms: [ppo]
tasks: [{scenario}]
traffic: [no_social_vehicles]
seeds: [3]
training: {sharing: all, rollout_fragment_length: 16}
environment: {agents: 2, time_limit: 12}
budget: {agent_steps: 1000}
evaluation: {validations: 2, validation_episodes: 1}
resources: {num_envs_per_env_runner: 2, parallel: 1}
tune: {parameters: {lr: [0.001, 0.0001]}, metric: return}
"""


def results_of(root):
    """Return what each trial reported, in order, by the name of its folder."""
    files = sorted(root.glob("trials/*/result.json"))
    return {file.parent.name: [json.loads(line) for line in file.open()] for file in files}


def test_a_search_that_is_interrupted_goes_on_and_ranks_its_trials(tmp_path):
    file = tmp_path / "search.yaml"
    mine = tmp_path / "mine"
    shutil.copytree(SUITE / "loop", mine, ignore=shutil.ignore_patterns("build"))
    # From where commands are given; Tune's trials have working directories of their own.
    file.write_text(SEARCH.replace("{scenario}", os.path.relpath(mine, SUITE.parent)))
    root = tmp_path / "results" / "search"
    command = ("sweep", str(file), "--out", str(tmp_path / "results"))
    first = begin(*command)
    wait_for(lambda: any(results_of(root).values()), first)
    first.send_signal(signal.SIGINT)
    code, out, err = finish(first)
    assert code == 130
    assert "give the same command again to resume" in err
    assert "table:" not in out
    assert not (root / "trials.csv").exists()
    (interrupted,) = [name for name, lines in results_of(root).items() if lines]
    # A failure of Tune's copying would be told here.
    assert "ERROR" not in err

    code, out, err = finish(begin(*command))
    assert code == 0, err
    found = results_of(root)
    assert len(found) == 2
    assert [line["validation"] for line in found[interrupted]] == [1, 2]
    steps = [line["agent_steps"] for line in found[interrupted]]
    assert steps[0] < 1000 <= steps[1]
    times = [
        (lines[0]["timestamp"] - lines[0]["time_this_iter_s"], lines[-1]["timestamp"])
        for lines in found.values()
    ]
    (_, ended), (began, _) = sorted(times)
    assert ended <= began + 1, "two trials at a time"  # timestamps are whole seconds

    with (root / "trials.csv").open() as table:
        rows = [*csv.DictReader(table)]
    assert {row["lr"] for row in rows} == {"0.001", "0.0001"}
    returns = [float(row["return"]) for row in rows]
    assert returns == sorted((lines[-1]["return"] for lines in found.values()), reverse=True)
    assert [row["validation"] for row in rows] == ["2", "2"]
    assert str(root / "trials.csv") in out


@pytest.mark.nightly
def test_a_search_that_is_finished_is_shown_again(tmp_path):
    file, root = tmp_path / "search.yaml", tmp_path / "results" / "search"
    file.write_text(SEARCH.replace("{scenario}", "loop").replace("validations: 2", "validations: 1"))
    command = ("sweep", str(file), "--out", str(tmp_path / "results"))
    assert finish(begin(*command))[0] == 0
    written = (root / "trials.csv").read_text()
    first, _ = sorted(root.glob("trials/*/result.json"))
    first.write_text("")  # as a kill may leave it
    (root / "trials.csv").unlink()
    assert finish(begin(*command))[0] == 0
    assert (root / "trials.csv").read_text() == written

    shutil.rmtree(root / "trials")
    code, out, err = finish(begin(*command))
    assert code == 0, err
    assert str(root / "trials.csv") in out  # from its table alone
    assert (root / "trials.csv").read_text() == written
    assert not (root / "trials").exists()


@pytest.mark.nightly
def test_trials_have_environment_runners(tmp_path):
    file = tmp_path / "runners.yaml"
    text = SEARCH.replace("{scenario}", "loop").replace("[0.001, 0.0001]", "[0.001]")
    file.write_text(text.replace("parallel: 1", "env_runners: 1").replace("validations: 2", "validations: 1"))
    code, out, err = finish(begin("sweep", str(file), "--out", str(tmp_path)))
    assert code == 0, err
    assert "runners/trials.csv" in out


FALTERING = '''
from pathlib import Path

from algorithms.ppo import PPO, PPOConfig, PPOLearner
from algorithms.registry import ActionKind, Entry, Paradigm
from algorithms.settings import NotNegative, PPOSettings


class Learner(PPOLearner):
    """PPO whose trials with some caution fail while a file is there."""

    def policy_loss(self, log_prob, old_log_prob, advantages):
        """Return PPO's loss."""
        if self.config.caution and Path("{broken}").exists():
            raise RuntimeError("the brakes are off")
        return super().policy_loss(log_prob, old_log_prob, advantages)


class Settings(PPOSettings):
    """PPO's settings, and one more."""

    caution: NotNegative = 0.0
    """Whether it may fail."""


class Config(PPOConfig):
    """Its config."""

    algorithm = "faltering"
    entry = Entry("faltering:Config", Settings, Paradigm.DECENTRALISED, "M1", ActionKind.BOTH, "failing")


class Faltering(PPO):
    """The algorithm."""

    config_class = Config
    learner_class = Learner
'''


@pytest.mark.nightly
def test_a_search_of_two_algorithms_is_stopped_between_them_and_one_of_its_trials_fails(tmp_path):
    file, broken = tmp_path / "both.yaml", tmp_path / "broken"
    (tmp_path / "faltering.py").write_text(FALTERING.replace("{broken}", str(broken)))
    text = SEARCH.replace("[ppo]", '[ppo, "faltering:Config"]').replace("{scenario}", "loop")
    text = text.replace("{lr: [0.001, 0.0001]}", "{lr: [0.001], caution: [0.0, 0.5]}")
    file.write_text(text.replace("validations: 2", "validations: 1"))
    root = tmp_path / "results" / "both"
    command = (
        "sweep",
        str(file),
        "--out",
        str(tmp_path / "results"),
        "--import",
        str(tmp_path / "faltering.py"),
    )

    def table(algorithm):
        (folder,) = root.glob(f"{algorithm}/*/*")
        return folder / "trials.csv"

    broken.touch()
    first = begin(*command)
    wait_for(lambda: any(root.glob("ppo/*/*/trials.csv")), first)
    first.send_signal(signal.SIGINT)
    code, _, err = finish(first)
    assert code == 130
    assert "give the same command again to resume" in err
    assert not table("faltering-Config").exists()
    searched = table("ppo").read_text()
    ended = {each: each.stat().st_mtime_ns for each in table("ppo").parent.rglob("result.json")}

    code, _, err = finish(begin(*command))
    assert code == 1, err
    assert "the brakes are off" in err
    assert "1 of 2 trials failed" in err
    with table("faltering-Config").open() as opened:
        assert [row["caution"] for row in csv.DictReader(opened)] == ["0.0"]
    assert not (root / "chosen.yaml").exists()

    broken.unlink()
    code, _, err = finish(begin(*command))
    assert code == 0, err
    with table("faltering-Config").open() as opened:
        assert {row["caution"] for row in csv.DictReader(opened)} == {"0.0", "0.5"}
    assert (root / "chosen.yaml").exists()
    assert table("ppo").read_text() == searched
    assert {each: each.stat().st_mtime_ns for each in table("ppo").parent.rglob("result.json")} == ended
