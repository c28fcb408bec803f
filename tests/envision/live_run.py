"""Steps environments until the process is ended: `python -m tests.envision.live_run HOST:PORT`."""

import sys
import time

import numpy as np

from smarts.env import VectorHiWayEnv
from smarts.sim.assembly import Options

PAUSE = 0.05
"""Between steps [s]: two steps of the simulation in real time."""

if __name__ == "__main__":
    env = VectorHiWayEnv(2, ["intersection"], 4, seed=1, simulation=Options(envision=sys.argv[1]))
    env.reset(seed=1)
    while True:
        env.step([np.zeros((2, 4), np.int64)])
        time.sleep(PAUSE)
