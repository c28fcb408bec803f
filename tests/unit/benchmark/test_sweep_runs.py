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
pytestmark = pytest.mark.timeout(3000)

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
