"""Agents for tests of hosts: well-behaved ones, and some that do what agents should not."""

import os
import subprocess
import sys
import time
from typing import Any, ClassVar

import numpy as np

from smarts.agents import ActionSpaceType, AgentInterface, DoneCriteria
from smarts.agents.policy import Agent, BatchAgent
from smarts.zoo import register
from smarts_agent_kit import uniform
from tests.easing import Easing

LANER = AgentInterface(
    action=ActionSpaceType.Lane, vehicle_model="kinematic", done_criteria=DoneCriteria(off_route=False)
)


class Drawing(BatchAgent):
    """Draws lane actions, and keeps in mind how often it has been asked about a vehicle."""

    interface = LANER
    observation = ("speed",)

    def __init__(self):
        self._asked = {}

    def act(self, obs):
        for row, key in enumerate(zip(obs.env_id.tolist(), obs.agent_id.tolist(), strict=True)):
            self._asked[key] = 0 if obs.is_first[row] else self._asked[key] + 1
        drawn = uniform(obs.seed, obs.step, 1)[:, 0]
        return np.where(drawn < 0.3, 1, 0)


class Misbehaving(BatchAgent):
    """Does something it should not at its third request.

    Args:
        how: Name of one of the methods.
    """

    interface = LANER
    observation = ("speed",)

    def __init__(self, how):
        self._do, self._asked = getattr(self, how), 0

    def act(self, obs):
        self._asked += 1
        if self._asked == 3:
            return self._do(len(obs.env_id))
        return np.zeros(len(obs.env_id), int)

    def loop(self, count):
        while True:
            pass

    def sleep(self, count):
        time.sleep(0.3)
        return np.zeros(count, int)

    def fork(self, count):
        if os.fork() == 0:
            time.sleep(1000)
        subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"])
        return np.zeros(count, int)

    def nothing(self, count):
        return np.zeros(count, int)

    def fill_the_memory(self, count):
        held = []
        while True:
            held.append(np.ones(2**24))

    def answer_texts(self, count):
        return np.array(["keep_lane"] * count)

    def answer_a_column(self, count):
        return np.zeros((count, 1), int)

    def answer_too_few(self, count):
        return np.zeros(count + 1, int)

    def answer_too_much(self, count):
        return np.zeros((count, 2**21))


class Sensing(Easing):
    """Observes the arrays of which `Observation` objects are made."""

    interface: ClassVar[Any] = Easing.interface | {
        "waypoint_paths": True,
        "neighborhood_vehicle_states": True,
    }
    observation: ClassVar[Any] = "raw"


class Describing(Agent):
    """Acts on objects."""

    interface = LANER

    def act(self, obs):
        return "keep_lane"


register("easing-v0", Easing)
register("sensing-v0", Sensing)
register("drawing-v0", Drawing)
register("misbehaving-v0", Misbehaving)
register("describing-v0", Describing)
