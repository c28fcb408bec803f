"""Whole experiments through the command line: finished, killed, resumed, refused."""

import csv
import json
import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

from algorithms.errors import CheckpointError
from algorithms.joint.episode_indices import FIRST_TEST_EPISODE
from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import task_settings_of
from benchmark.metrics import compute, read_table
from benchmark.results.files import PARTIAL, ResultsError, locked
from benchmark.running.evaluating import Asked, evaluate_checkpoint
from benchmark.running.played import held_out_of
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from tests.commands import begin, finish, wait_for
from tests.raising import raises
from tests.scalar_files import read_scalars

TINY = """
algorithms: [ppo]
tasks: [double_merge]
traffic: [no_social_vehicles]
seeds: [3]
training: {sharing: all, rollout_fragment_length: 16}
environment: {agents: 2, time_limit: 20}
budget: {agent_steps: 6000}
evaluation: {episodes: 3, held_out_episodes: 1, validations: 2, validation_episodes: 2}
scripted: [parked]
resources: {num_envs_per_env_runner: 2, parallel: 1}
"""
RUN = "tiny/ppo/double_merge/no_social_vehicles/seed_3"


def experiment_in(folder):
    file = folder / "tiny.yaml"
    file.write_text(TINY)
    return file


def start(file, *more, **options):
    return begin("run", str(file), "--out", str(file.parent / "results"), *more, **options)


def progress(folder):
    with (folder / "progress.csv").open() as file:
        return [*csv.DictReader(file)]


@pytest.fixture(scope="module")
def continued(tmp_path_factory):
    """An experiment whose run was killed and continued, the run's folder, and the checkpoint at the kill."""
    experiment = experiment_in(tmp_path_factory.mktemp("continued"))
    root, run = experiment.parent / "results" / "tiny", experiment.parent / "results" / RUN
    first = start(experiment)
    wait_for(lambda: (run / "checkpoint" / "training.json").exists(), first)
    first.send_signal(signal.SIGKILL)  # at once, while half of the training is still to come
    first.communicate()
    kept = json.loads((run / "checkpoint" / "training.json").read_text())
    assert kept["iteration"] > 0

    (root / "command.json").unlink()
    goes_on = start(experiment)
    wait_for(lambda: (root / "command.json").exists(), goes_on)
    with raises(ResultsError, root, values=[goes_on.pid]), locked(root):
        pass
    code, _, err = finish(goes_on)
    assert code == 0, err
    return experiment, run, kept


def test_a_run_that_is_killed_goes_on_and_is_finished_once(continued):
    experiment, run, kept = continued
    root = experiment.parent / "results" / "tiny"
    lines = progress(run)
    assert [int(line["iteration"]) for line in lines] == [*range(1, len(lines) + 1)]
    steps = [int(line["agent_steps"]) for line in lines]
    assert all(np.diff(steps) > 0)
    # Over the kill as well: what comes after the checkpoint goes on from its counts.
    assert steps[kept["iteration"] - 1] == kept["agent_steps"] < steps[kept["iteration"]]
    seconds = [float(line["seconds"]) for line in lines]
    assert seconds[kept["iteration"] - 1] == pytest.approx(kept["seconds"], abs=0.01)
    assert all(np.diff(seconds) >= 0)
    assert steps[-2] < 6000 <= steps[-1] < 6000 + 2 * 2 * 5  # the decisions of two agents in two simulations
    assert sum(line["validation_completion"] != "" for line in lines) == 2
    scalars = read_scalars(run / "tensorboard")
    assert scalars["completion"] == {
        int(line["agent_steps"]): pytest.approx(float(line["completion"]), nan_ok=True)
        for line in lines
        if line["completion"] != "nan"
    }
    assert len(scalars["validation_return"]) == 2
    facts = json.loads((run / "run.json").read_text())
    assert (facts["status"], facts["ended_by"]) == ("finished", "agent_steps")
    assert "command" not in facts  # a worker's is Ray's; the user's is in command.json
    assert json.loads((root / "command.json").read_text())["command"].endswith(
        f"--out {experiment.parent}/results"
    )
    table = read_table(run / "episodes.parquet")
    # Three episodes of two agents, and one of a held-out variation.
    assert table.groupby("mode").size().to_dict() == {"greedy": 6 + 2, "sampled": 6}
    assert table.attrs["episodes"] == {"measured": 7, "invalid": 0, "incomplete": 0, "corrupted": {}}
    assert not (run / "episodes").exists()
    parked = read_table(root / "scripted/parked/double_merge/no_social_vehicles/episodes.parquet")
    rates = compute(parked, metrics=["completion_rate"])
    assert set(rates["value"]) == {0.0}
    # The scripted policy begins its episodes as the trained policy does.
    starts = ["world", "agent", "start_x", "start_y", "start_speed"]
    greedy = table.query("mode == 'greedy' and split == 'train'")
    driven = parked.query("split == 'train'")
    assert len(greedy) == 6
    assert np.array_equal(greedy[starts].to_numpy(), driven[starts].to_numpy())


def test_a_finished_run_trains_on_with_a_larger_budget_and_is_tested_in_another_way(continued, tmp_path):
    experiment, run, _ = continued
    lines = progress(run)
    shutil.copytree(experiment.parent, tmp_path / "copy")
    experiment, run = tmp_path / "copy" / experiment.name, tmp_path / "copy" / "results" / RUN
    more = ("--set", "budget.agent_steps=9000", "--set", "evaluation.episodes=1")
    assert finish(start(experiment, *more))[0] == 0
    longer = progress(run)
    assert longer[: len(lines)] == lines
    steps = [int(line["agent_steps"]) for line in longer]
    assert steps[-1] >= 9000 > steps[-2] > steps[len(lines) - 1]
    # Those at 3,000 and 6,000, and of two in 9,000 the second.
    assert sum(line["validation_completion"] != "" for line in longer) == 3
    facts = json.loads((run / "run.json").read_text())
    assert (facts["status"], facts["ended_by"], facts["tested"]["episodes"]) == ("finished", "agent_steps", 1)
    assert len(read_table(run / "episodes.parquet")) == 2 * 3


@pytest.fixture
def training(tmp_path):
    """A training that does not end by itself, after its second iteration, and its folder."""
    experiment, run = experiment_in(tmp_path), tmp_path / "results" / RUN
    endless = ("--set", "scripted=[]", "--set", "budget.agent_steps=1000000")
    process = start(experiment, *endless, start_new_session=True)
    wait_for(lambda: (run / "progress.csv").exists() and len(progress(run)) >= 2, process)
    return process, run


def test_a_worker_that_is_killed_is_replaced_and_sigterm_loses_nothing(training):
    process, run = training
    (worker,) = workers(process.pid)
    os.kill(worker, signal.SIGKILL)
    wait_for(lambda: len(found := workers(process.pid)) == 1 and found != [worker], process)
    known = len(progress(run))
    wait_for(lambda: len(progress(run)) > max(known, 3), process)
    os.killpg(process.pid, signal.SIGTERM)  # to the command's process group, as a batch system does
    code, _, err = finish(process)
    assert code == 130
    assert "GCS" not in err
    assert "give the same command again to resume" in err
    lines = progress(run)
    # The validations, of which each saves, are half a million steps away.
    kept = json.loads((run / "checkpoint" / "training.json").read_text())
    assert kept["iteration"] == len(lines)
    assert kept["agent_steps"] == int(lines[-1]["agent_steps"])


def workers(driver):
    """Return the processes that carry out runs for a driver."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                title = (folder / "cmdline").read_bytes()
                session = int((folder / "stat").read_text().rpartition(")")[2].split()[3])
            except (OSError, ValueError):
                continue
            if b"ray::_execute" in title and session == os.getsid(driver):
                found.append(int(folder.name))
    return found


BY_TRAFFIC = {
    "no_social_vehicles": {"three_lanes"},
    "random_social_vehicles": {"dense", "sparse_impatient", "all_cross", "three_lanes"},
}
"""Held-out variations of double merge: without traffic, only that of the map differs from the training."""


def test_what_is_held_out_differs_from_what_was_trained_on(tmp_path):
    for cell in task_settings_of(read_experiment(experiment_in(tmp_path), [f"traffic={[*BY_TRAFFIC]}"])):
        found = {name.removeprefix("double_merge@") for name in held_out_of(cell)}
        assert found == BY_TRAFFIC[cell.traffic]


def test_generalization_compares_the_splits_of_a_task(continued):
    _, run, _ = continued
    table = read_table(run / "episodes.parquet")
    held = table[table["split"] == "held_out"]
    trained = table[(table["split"] == "train") & (table["mode"] == "greedy")]
    assert held["variation"].tolist() == ["three_lanes"] * 2  # one episode of 2 agents
    assert set(held["mode"]) == {"greedy"}
    assert len(trained) == 3 * 2
    (found,) = compute(table[table["mode"] == "greedy"], metrics=["generalization"]).to_dict("records")
    assert found["worst"] == "double_merge@three_lanes"
    for split, rows in (("train", trained), ("held_out", held)):
        assert found["terms"][f"{split}_completion"] == (rows["outcome"] == "goal").mean()
        assert found["terms"][f"{split}_non_collision"] == 1 - (rows["outcome"] == "collision").mean()


def test_a_damaged_checkpoint_is_named_and_the_other_one_can_be_tested(continued, tmp_path):
    run = tmp_path / "seed_3"
    shutil.copytree(continued[1], run)
    damaged = run / "checkpoint" / "learner_group" / "learner" / "rl_module" / "shared" / "module_state.pkl"
    damaged.write_bytes(damaged.read_bytes()[:100])
    short = {"asked": Asked(episodes=1), "modes": ("greedy",)}
    with raises(ResultsError, damaged, values=["not as it was written"]) as caught:
        evaluate_checkpoint(run, **short)
    assert "--checkpoint" in caught.value.remedy
    assert len(evaluate_checkpoint(run, **short, checkpoint="best")) == 2

    config = run / "config.yaml"
    config.write_text(config.read_text().replace("algorithm: ppo", "algorithm: a2c"))
    with pytest.raises(CheckpointError, match="algorithm"):
        evaluate_checkpoint(run, **short, checkpoint="best")


def test_recordings_are_those_that_were_asked_for(continued, tmp_path):
    (_, run, _), out = continued, tmp_path / "again"
    code, printed, err = finish(begin("evaluate", str(run), "--episodes", "3", "--out", str(out)))
    assert code == 0, err
    assert "greedy: 6 agent-episodes of double_merge, no_social_vehicles" in printed
    for mode in ("greedy", "sampled"):
        kept = episodes_in(out / "episodes" / f"{mode}-double_merge")
        assert len(kept) == 3  # two simulations begin a fourth
        assert {int(RecordedEpisode(path).facts["world"]) - FIRST_TEST_EPISODE for path in kept} == {0, 1, 2}


def test_a_test_that_is_interrupted_says_so_and_leaves_no_table(continued, tmp_path):
    (_, run, _), out = continued, tmp_path / "again"
    playing = begin("evaluate", str(run), "--episodes", "10000", "--out", str(out))
    wait_for(lambda: any(tmp_path.glob(f"{PARTIAL}-again/episodes/*/*")), playing)
    playing.send_signal(signal.SIGTERM)  # as Ctrl-C, which may be ignored where the tests run
    code, printed, err = finish(playing)
    assert (code, printed) == (130, "")
    assert err.splitlines()[-1] == f"interrupted; no table was written to {out}"
    assert "Traceback" not in err
    assert not any(tmp_path.iterdir())
