"""Results on disk are whole or not there, whatever fails or is killed when."""

import os
import pickle
import shutil
import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from benchmark.experiment.algorithm_settings import settings_of
from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.commands import keep_command, read_commands
from benchmark.results.files import (
    PARTIAL,
    ResultsError,
    locked,
    previous_of,
    read_json,
    recover_folder,
    replaced_folder,
)
from benchmark.results.reading import read_results
from benchmark.results.run_folder import RunFolder
from benchmark.running.jobs import JobScheduler, jobs_of
from benchmark.running.messages import Began
from benchmark.running.training import check_checkpoint, checkpoint_files
from benchmark.running.writing import RunWriter
from tests.hand_made_results import finish_runs, write_experiment
from tests.raising import raises

ROOT = Path(__file__).parents[3]


def save(folder, weights, state):
    """Keep a last checkpoint, as the driver of a run does."""
    folder.keep("checkpoint", checkpoint_files(FakeAlgo(weights), state))


class FakeAlgo:
    def __init__(self, content):
        self.content = content

    def save_to_path(self, path):
        os.makedirs(path, exist_ok=True)
        with open(f"{path}/weights", "w") as file:
            file.write(self.content)


def test_a_full_disk_is_named_and_leaves_the_old_file(tmp_path):
    # A limit on the size of files makes the write fail as a full disk does.
    code = (
        "import resource, signal, sys; from pathlib import Path\n"
        "from benchmark.results.files import write_json, ResultsError\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "write_json(Path(sys.argv[1]), {'a': 1})\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try: write_json(Path(sys.argv[1]), {'a': 'x' * 5000})\n"
        "except ResultsError as error: print(error)\n"
    )
    file = tmp_path / "a.json"
    out = subprocess.run(
        [sys.executable, "-c", code, str(file)], capture_output=True, text=True, check=True
    ).stdout
    assert "cannot be written: File too large" in out
    assert "free some space" in out
    assert read_json(file) == {"a": 1}
    assert [*tmp_path.iterdir()] == [file]


@pytest.mark.parametrize("moment", ["partial", "between"])
def test_a_kill_while_a_folder_is_replaced_leaves_one_that_is_whole(tmp_path, moment):
    folder = tmp_path / "checkpoint"
    with replaced_folder(folder) as path:
        FakeAlgo("old").save_to_path(path)
    partial = tmp_path / f"{PARTIAL}-checkpoint"
    FakeAlgo("new").save_to_path(str(partial))
    if moment == "between":
        folder.rename(previous_of(folder))
    recover_folder(folder)
    assert (folder / "weights").read_text() == "old"
    assert [*tmp_path.iterdir()] == [folder]


def test_a_folder_is_on_disk_before_the_one_that_was_there_goes(tmp_path, monkeypatch):
    folder = tmp_path / "checkpoint"
    with replaced_folder(folder) as path:
        FakeAlgo("old").save_to_path(path)
    synced, sync = {}, os.fsync

    def watched(descriptor):
        synced[os.readlink(f"/proc/self/fd/{descriptor}")] = (folder / "weights").read_text()
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    with replaced_folder(folder) as path:
        FakeAlgo("new").save_to_path(path)
    partial = str(tmp_path / f"{PARTIAL}-checkpoint")
    assert synced == {f"{partial}/weights": "old", partial: "old", str(tmp_path): "new"}


def test_a_second_writer_is_refused_and_a_dead_one_is_not_in_the_way(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from benchmark.results.files import locked\n"
        "with locked(Path(sys.argv[1])): print('locked', flush=True); time.sleep(60)\n"
    )
    holder = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout
        assert holder.stdout.readline() == "locked\n"
        with raises(ResultsError, tmp_path, values=[holder.pid]), locked(tmp_path):
            pass
    finally:
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    with locked(tmp_path):
        pass


@pytest.mark.parametrize(
    ("there", "here", "fits"),
    [
        ((9000, None), (9001, None), True),
        ((9000, None), (8999, None), False),
        ((9000, 2.0), (9000, None), True),
        ((9000, 2.0), (9001, 1.0), False),
    ],
)
def test_a_budget_may_grow_and_nothing_else_may_change(tmp_path, there, here, fits):
    contents = [
        {"seed": 1, "budget": dict(zip(("agent_steps", "minutes"), each, strict=True))}
        for each in (there, here)
    ]
    folder = RunFolder(tmp_path / "run")
    folder.open(contents[0])
    save(folder, "1", {"iteration": 1})
    folder.note(status="finished")
    with raises(ResultsError, folder.config, values=["seed"]):
        folder.check({**contents[1], "seed": 2})
    if not fits:
        with raises(ResultsError, folder.config, values=["budget."]):
            folder.open(contents[1])
        return
    assert folder.is_extended(contents[1])
    folder.open(contents[1])
    assert folder.status == "training"
    assert folder.read_config() == contents[1]
    assert not folder.is_extended(contents[1])


def test_own_code_may_be_added_and_none_be_exchanged(tmp_path):
    folder = RunFolder(tmp_path / "run")
    folder.open({"a": 1})
    folder.note(status="finished")
    folder.check({"a": 1, "imports": ["/code/metric.py"]})
    folder.open({"a": 1, "imports": ["/code/metric.py", "/code/mine"]})  # tested again, with the metric
    assert folder.read_config()["imports"] == ["/code/metric.py", "/code/mine"]
    folder.check({"a": 1, "imports": ["/code/mine", "/code/metric.py"]})
    folder.check({"a": 1})
    with raises(ResultsError, folder.config, values=["imports", "/code/mine", "/other/mine"]):
        folder.check({"a": 1, "imports": ["/other/mine"]})


def test_the_committed_results_are_finished(tmp_path):
    """Whatever keys with defaults configs have got since; on a copy, since nothing may be written there."""
    shutil.copytree(ROOT / "results" / "paper_track", tmp_path / "table")
    config = ROOT / "configs" / "paper_track.yaml"
    experiment = read_experiment(config)
    driver = JobScheduler(jobs_of(experiment), tmp_path / "table", experiment.resources)
    assert driver.is_done
    larger = read_experiment(config, ["algorithms=[ppo]", "budget.agent_steps=3000000"])
    with raises(ResultsError, "seed_1", values=["checkpoint"]):
        JobScheduler(jobs_of(larger), tmp_path / "table", larger.resources)


def test_a_run_that_has_left_nothing_takes_a_corrected_config(tmp_path):
    """Failed at its first settings."""
    folder = RunFolder(tmp_path / "run")
    folder.open({"a": 1})
    folder.note(status="training", scenarios={"loop": "old"})
    assert folder.changed_scenarios({"loop": "new"}) == []
    folder.open({"a": 2})
    assert folder.status is None
    assert folder.read_config() == {"a": 2}


def test_a_folder_that_is_filled_by_parts_keeps_all_commands_and_expects_all_runs(tmp_path):
    write_experiment(tmp_path, seeds=[1, 2])
    _, (first,) = read_commands(tmp_path, {})
    second = first.model_copy(update={"algorithms": ("dqn",), "seeds": (1,)})
    for line, experiment in (("b", second), ("c", first), ("b", second)):
        keep_command(tmp_path, experiment, line)
    assert read_json(tmp_path / "command.json")["command"] == "b"
    results = read_results(tmp_path)
    assert results.commands == ("smarts-bench run hand.yaml", "c", "b")
    assert [(run.algorithm, run.seed) for run in results.runs] == [("dqn", 1), ("ppo", 1), ("ppo", 2)]
    assert not results.problems


def test_weights_of_a_checkpoint_that_are_not_finite_are_refused(tmp_path):
    file = tmp_path / "learner_group/learner/rl_module/shared/module_state.pkl"
    file.parent.mkdir(parents=True)
    for last in (0.5, np.nan):
        weights = {"policy.0.weight": np.zeros((2, 3), np.float32), "policy.0.bias": np.array([1.0, last])}
        file.write_bytes(pickle.dumps(weights))
        with nullcontext() if last == 0.5 else raises(ResultsError, file, values=["policy.0.bias"]):
            check_checkpoint(tmp_path)


def test_a_run_keeps_the_defaults_of_its_begin(tmp_path):
    """With a version that has other defaults it would train on as another run."""
    file = tmp_path / "one.yaml"
    file.write_text(
        "algorithms: [ppo]\ntasks: [loop]\ntraffic: [no_social_vehicles]\nseeds: [1]\n"
        "settings: {ppo: {lr: 0.1}}\n"
    )
    (run,), (as_then,) = (
        runs_of(read_experiment(file, more)) for more in ((), ("settings.ppo={lr: 0.1, gamma: 0.5}",))
    )
    folder = RunFolder(tmp_path / "run")
    writer = RunWriter(run, folder)
    writer.take(Began({"commit": "abc"}, {}))
    writer.close()
    defaults = folder.facts()["defaults"]
    assert defaults["gamma"] == settings_of("ppo")().gamma
    assert "lr" not in defaults  # given, in config.yaml
    save(folder, "1", {"iteration": 1})
    folder.check(run.content())
    folder.note(
        defaults={**defaults, "gamma": 0.5, "of_another_version": 1}
    )  # begun when 0.5 was the default
    with raises(ResultsError, folder.config, values=["settings.gamma", "0.5"]) as caught:
        folder.check(run.content())
    assert "set the old values in `settings`" in caught.value.remedy
    folder.check(as_then.content())


def test_episodes_that_are_wanted_and_not_there_are_played_again(tmp_path):
    file = tmp_path / "one.yaml"
    file.write_text(
        "algorithms: [ppo]\ntasks: [loop]\ntraffic: [no_social_vehicles]\nseeds: [1]\n"
        "evaluation: {episodes: 1, modes: [greedy]}\n"
    )
    plain, keeping = (read_experiment(file, more) for more in ((), ("evaluation.keep_episodes=true",)))
    folder = finish_runs(plain, tmp_path)

    def is_done(experiment):
        return JobScheduler(jobs_of(experiment), tmp_path, experiment.resources).is_done

    assert is_done(plain)
    assert not is_done(keeping)
    folder.episodes.mkdir()
    assert is_done(keeping)
    folder.episodes.rmdir()
    folder.progress.write_text("")  # trained, and the checkpoint was removed
    assert is_done(keeping)
