"""Every algorithm as an RLlib algorithm: trained, saved, and restored and continued in another process."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import ray
from rigs import first, known

import algorithms
from tests.games.games import Cues
from tests.learner_states import differing, values_in

ROOT = Path(__file__).resolve().parents[4]
REPLAY = {"learning_starts": 32, "batch_size": 16, "capacity": 500, "updates_per_step": 0.1}
RESTORE = """
import json, sys
import ray
from algorithms import config
ray.init(address=sys.argv[1], log_to_driver=False)
scores = {}
for name in sys.argv[3:]:
    algo = config(name).algo_class.from_checkpoint(f"{sys.argv[2]}/{name}")
    algo.save_to_path(f"{sys.argv[2]}/{name}-restored")
    scores[name] = algo.evaluate()["env_runners"]["episode_return_mean"]
    algo.train()
    algo.save_to_path(f"{sys.argv[2]}/{name}-continued there")
    algo.stop()
print(json.dumps(scores))
"""


FEW = {"ppo", "maddpg", "networked_q", "bc"}
REST = {*algorithms.names()} - FEW


@pytest.fixture(scope="module", params=first(FEW, REST), ids=["few", "rest"])
def scores(request, cluster, tmp_path_factory):
    """Return checkpoints, also of one iteration later, and each algorithm's score before it was saved."""
    folder, found = tmp_path_factory.mktemp("checkpoints"), {}
    pq.write_table(pa.table({"obs": np.eye(4).tolist(), "actions": [1, 2, 3, 0]}), folder / "cues")
    given = {**REPLAY, "data": str(folder / "cues"), "updates": 3}
    for name in sorted(request.param):
        config = algorithms.config(name).environment(Cues).debugging(seed=3)
        config.env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=24)
        config.evaluation(evaluation_duration=4)
        own = known(name, given if name == "bc" else REPLAY)
        algo = config.training(hidden=(16,), **own).build_algo()
        for _ in range(2):
            result = algo.train()
        found[name] = algo.evaluate()["env_runners"]["episode_return_mean"]
        assert result["env_runners"]["num_env_steps_sampled_lifetime"] == 96
        algo.save_to_path(str(folder / name))
        algo.train()
        algo.save_to_path(str(folder / f"{name}-continued"))
        algo.stop()
    return folder, found


@pytest.fixture(scope="module")
def restored(scores):
    """Save in another process what is restored, and again one iteration later; return the scores there."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", RESTORE, ray.get_runtime_context().gcs_address, str(scores[0]), *scores[1]],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_a_checkpoint_plays_the_same_in_another_process(scores, restored):
    assert restored == scores[1]


@pytest.mark.usefixtures("restored")
def test_a_checkpoint_is_restored_and_continued_in_another_process_to_the_last_bit(scores):
    """All that learners store, value by value: weights, targets, optimisers, replay, random generators."""
    folder, found = scores
    for name in found:
        saved, restored, continued, there = (
            values_in(folder / f"{name}{place}")
            for place in ("", "-restored", "-continued", "-continued there")
        )
        assert differing(saved, restored) == [], name
        assert differing(continued, there) == [], name
        assert networks_at(differing(saved, continued)) == networks_at(saved) != set(), name


def networks_at(places):
    """Return the networks to which places of values belong."""
    return {part[3] for part in (place.split("/") for place in places) if part[4:5] == ["module_state"]}
