"""Equal seeds give equal runs: hashes of all vehicle states over 400 steps do not depend on the batch."""

import hashlib
import json
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np

from smarts.env.vector import VectorHiWayEnv
from smarts.types.actions import LaneAction

SCENARIOS = ["intersection", "double_merge"]
DECISIONS, PERIOD, EGOS, SEED = 80, 5, 4, 7


def hashes(worlds):
    """Return for each world the hash of its states and of what agents get over 400 steps."""
    env = VectorHiWayEnv(len(worlds), SCENARIOS, EGOS, decision_interval=PERIOD)
    made = [hashlib.blake2b(digest_size=16) for _ in worlds]
    with closing(env):
        env.reset(SEED, np.array(worlds))
        decisions, episodes = np.zeros(len(worlds), int), [0] * len(worlds)
        state = env._runner.world
        for _ in range(DECISIONS):
            now = env.step([np.array([_actions(*pair) for pair in zip(worlds, decisions, strict=True)])])
            decisions += 1
            for row, hashed in enumerate(made):
                for column in state.vehicles:
                    hashed.update(column[row].tobytes())
                for part in (
                    now.rewards,
                    now.observations[0][""],
                    now.masks[0],
                    now.terminated,
                    now.truncated,
                ):
                    hashed.update(part[row].tobytes())
                episodes[row] += bool(now.reset[row])
    assert min(episodes) >= 1
    return [hashed.hexdigest() for hashed in made]


def _actions(world, decision):
    """Return the actions of the egos, a function of world, decision and agent."""
    draws = np.random.Generator(np.random.Philox(key=int(world) * 1000 + int(decision)))
    return draws.choice([LaneAction.keep_lane] * 2 + [*LaneAction], size=EGOS)


def in_parallel_processes(*lists):
    """Return the hashes of lists of worlds, each list played in its own process at the same time."""
    code = "import json, sys; from tests.contracts.test_same_seed import hashes; print(json.dumps(hashes("
    code += "json.loads(sys.argv[1]))))"
    # Each process has another seed of string hashes, which must have no effect.
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", code, json.dumps(worlds)],
            cwd=Path(__file__).parents[2],
            env={**os.environ, "PYTHONHASHSEED": str(number)},
            stdout=subprocess.PIPE,
        )
        for number, worlds in enumerate(lists, 1)
    ]
    outputs = [process.communicate()[0] for process in processes]
    assert [process.returncode for process in processes] == [0] * len(lists)
    return [json.loads(output.splitlines()[-1]) for output in outputs]


def test_hashes_do_not_depend_on_batch_and_process():
    together = hashes([0, 1, 2, 3])
    assert len(set(together)) == 4
    assert hashes([3, 0]) == [together[3], together[0]]
    # Two environment runners share the worlds of one.
    first, second = in_parallel_processes([0, 1], [2, 3])
    assert first + second == together
