"""Whole experiments through the command line: finished, killed, resumed, refused."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmark.metrics import compute, read_table

pytestmark = pytest.mark.slow

TINY = """
algorithms: [ppo]
tasks: [loop]
traffic: [no_social_vehicles]
seeds: [3]
training: {sharing: all, rollout_fragment_length: 16}
environment: {agents: 2}
budget: {agent_steps: 4000}
evaluation: {episodes: 3, modes: [greedy, sampled], validations: 2, validation_episodes: 2}
reference: [parked]
resources: {copies: 2, parallel: 1}
"""
LIMIT = 400.0
"""Patience with a command [s]."""


@pytest.fixture
def experiment(tmp_path):
    file = tmp_path / "tiny.yaml"
    file.write_text(TINY)
    return file


def start(file, *more):
    command = [sys.executable, "-c", "from benchmark.cli import main; main()", "run", str(file)]
    command += ["--out", str(file.parent / "results"), *more]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[3]
    )


def finish(process):
    out, err = process.communicate(timeout=LIMIT)
    return process.returncode, out, err


def progress(folder):
    with (folder / "progress.csv").open() as file:
        return [*csv.DictReader(file)]


def wait_for(condition, process):
    end = time.monotonic() + LIMIT
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.05)


def test_a_run_that_is_killed_goes_on_and_is_finished_once(experiment):
    root = experiment.parent / "results" / "tiny"
    run = root / "ppo/loop/no_social_vehicles/seed_3"
    first = start(experiment)
    wait_for(lambda: (run / "checkpoint" / "training.json").exists(), first)
    assert "is writing here" in (second := finish(start(experiment)))[2]
    assert second[0] == 2
    first.send_signal(signal.SIGKILL)
    first.communicate()
    kept = json.loads((run / "checkpoint" / "training.json").read_text())
    assert kept["iteration"] > 0

    assert finish(start(experiment))[0] == 0
    lines = progress(run)
    assert [int(line["iteration"]) for line in lines] == [*range(1, len(lines) + 1)]
    assert int(lines[-1]["agent_steps"]) >= 4000 > int(lines[-2]["agent_steps"])
    assert sum(line["validation_completion"] != "" for line in lines) == 2
    facts = json.loads((run / "run.json").read_text())
    assert facts["status"] == "finished"
    table = read_table(run / "episodes.parquet")
    assert table.groupby("mode").size().to_dict() == {"greedy": 6, "sampled": 6}  # 3 episodes of 2 agents
    assert table.attrs["episodes"] == {"measured": 6, "void": 0, "incomplete": 0, "corrupted": {}}
    assert not (run / "episodes").exists()
    parked = read_table(root / "reference/parked/loop/no_social_vehicles/episodes.parquet")
    rates = compute(parked, metrics=["completion_rate"])
    assert rates["value"].tolist() == [0.0]
    # The reference begins its episodes as the trained policy does.
    starts = ["world", "agent", "start_x", "start_y", "start_speed"]
    greedy = table.query("mode == 'greedy'")
    assert np.array_equal(greedy[starts].to_numpy(), parked[starts].to_numpy())

    written = (run / "run.json").stat().st_mtime_ns
    assert finish(start(experiment))[0] == 0
    assert (run / "run.json").stat().st_mtime_ns == written  # what is finished is left alone
    code, _, err = finish(start(experiment, "--set", "training.lr=0.5"))
    assert code == 2
    assert "a run with another config" in err
    assert finish(start(experiment, "--set", "evaluation.episodes=1"))[0] == 0  # trained already, tested anew
    assert len(read_table(run / "episodes.parquet")) == 2 * 2
    assert len(progress(run)) == len(lines)


def test_a_worker_that_is_killed_is_replaced_and_sigterm_says_how_to_go_on(experiment):
    run = experiment.parent / "results/tiny/ppo/loop/no_social_vehicles/seed_3"
    process = start(experiment, "--set", "reference=[]", "--set", "budget.agent_steps=1000000")
    wait_for(lambda: (run / "progress.csv").exists() and len(progress(run)) >= 2, process)
    (worker,) = workers(process.pid)
    os.kill(worker, signal.SIGKILL)
    wait_for(lambda: len(found := workers(process.pid)) == 1 and found != [worker], process)
    process.send_signal(signal.SIGTERM)
    code, _, err = finish(process)
    assert code == 130
    assert "the same command goes on" in err


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
            if b"ray::_carry_out" in title and session == os.getsid(driver):
                found.append(int(folder.name))
    return found
