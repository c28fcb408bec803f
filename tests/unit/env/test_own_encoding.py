"""Adapters that say how their agents act: one number in [0, 1] that stands for a target speed."""

import numpy as np
from gymnasium.spaces import Box

from smarts.agents import ActionSpaceType, AgentInterface
from smarts.env import HiWayEnv, VectorHiWayEnv, hiway_parallel_env
from smarts.env.adapters import ObservationAndReward

TOP = 20.0
FAST = AgentInterface(action=ActionSpaceType.LaneWithContinuousSpeed)


class SpeedShare(ObservationAndReward):
    """Lets agents choose a share of 20 m/s, and keeps them in their lane."""

    def __init__(self, context, *given):
        super().__init__(context, *given)
        self._agent_ids = context.agent_ids
        self.action_space = Box(0.0, 1.0, (1,), np.float32)

    def encode(self, given, chosen, out):
        rows, columns = np.nonzero(chosen)
        agent_ids = self._agent_ids[columns]
        out.values[rows, agent_ids, 0] = TOP * given[rows, columns, 0]
        out.values[rows, agent_ids, 1] = 0.0
        out.given[rows, agent_ids] = out.fresh[rows, agent_ids] = True


def speeds(env):
    world = env._runner.world if hasattr(env, "_runner") else env._env.runner.world
    return world.vehicles.speed[0, world.agents.slot[0, : world.egos]].tolist()


def test_every_environment_takes_the_adapters_own_actions(closing):
    agents = {"a": FAST, "b": FAST}
    plain = closing(HiWayEnv(["loop"], agents, decision_interval=5))
    by_name = closing(hiway_parallel_env(["loop"], agents, adapter=SpeedShare))
    by_array = closing(VectorHiWayEnv(1, ["loop"], agents, adapter=f"{__name__}:SpeedShare"))
    assert by_name.action_space("a") == by_array.spaces.blocks[0].action == Box(0.0, 1.0, (1,), np.float32)
    for env in (plain, by_name):
        env.reset(seed=1)
    by_array.reset(1)
    for _ in range(6):
        plain.step({"a": (0.5 * TOP, 0), "b": (TOP, 0)})
        by_name.step({"a": [0.5], "b": [1.0]})
        by_array.step([np.array([[[0.5], [1.0]]])])
    assert speeds(plain) == speeds(by_name) == speeds(by_array)
    assert speeds(plain)[1] > speeds(plain)[0] > 1.0
