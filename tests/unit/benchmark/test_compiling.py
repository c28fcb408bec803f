"""After `smarts-bench compile`, nothing is left to compile."""

import os
import subprocess
import sys

import pytest

LATER = """
import numpy as np
from smarts.agents.interface import AgentInterface, AgentType
from smarts.env.hiway import HiWayEnv
from smarts.env.vector import VectorHiWayEnv
from smarts.geometry.compiling import Compilations
from smarts.sim.options import Options
with Compilations() as compiled:
    env = VectorHiWayEnv(3, ["double_merge"], 4, seed=7)
    env.reset()
    for _ in range(30):
        env.step([np.full((3, 4), 2)])
    env.close()
    env = VectorHiWayEnv(1, ["two_way"], 1, simulation=Options(traffic_engine="Native"))
    env.reset()
    env.step([np.zeros((1, 1), int)])
    env.close()
    for kind in (AgentType.Full, AgentType.Boid, AgentType.MPCTracker, AgentType.TrajectoryInterpolator):
        env = HiWayEnv(["two_way"], {"agent": AgentInterface.from_type(kind)})
        env.reset()
        env.step({})
        env.close()
print(compiled.count)
"""


@pytest.mark.timeout(1200)
def test_later_environments_compile_nothing():
    """With the cache of this checkout, which other tests fill as well: the command must find it enough."""
    command = [sys.executable, "-m", "benchmark.cli", "compile"]
    subprocess.run(command, capture_output=True, check=True)
    later = subprocess.run([sys.executable, "-c", LATER], env=os.environ, capture_output=True, text=True)
    assert (later.stdout, later.stderr) == ("0\n", "")
