"""Adapters that say how their agents act: one number in [0, 1] that stands for a target speed."""

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from smarts.agents import ActionSpaceType, AgentInterface, AgentSpec
from smarts.env import HiWayEnv, VectorHiWayEnv, hiway_parallel_env
from smarts.env.adapters import ObservationAndReward
from smarts.errors import ActionError

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


class Gears(SpeedShare):
    """Lets agents choose one of three speeds."""

    def __init__(self, context, *given):
        super().__init__(context, *given)
        self.action_space = Discrete(3)

    def encode(self, given, chosen, out):
        super().encode(given[..., None] / 2.0, chosen, out)


def speeds(env):
    world = env._runner.world if hasattr(env, "_runner") else env._env.runner.world
    return world.vehicles.speed[0, world.agents.slot[0, : world.egos]].tolist()


def test_every_environment_takes_the_adapters_own_actions(closing):
    agents = {"a": FAST, "b": FAST}
    plain = closing(HiWayEnv(["loop"], agents, decision_interval=5))
    by_name = closing(hiway_parallel_env(["loop"], agents, adapter=SpeedShare))
    by_array = closing(VectorHiWayEnv(1, ["loop"], agents, adapter=f"{__name__}:SpeedShare"))
    gears = closing(hiway_parallel_env(["loop"], agents, adapter=Gears))
    assert by_name.action_space("a") == by_array.spaces.blocks[0].action == Box(0.0, 1.0, (1,), np.float32)
    assert gears.action_space("a") == Discrete(3)
    for env in (plain, by_name, gears):
        env.reset(seed=1)
    by_array.reset(1)
    for _ in range(6):
        plain.step({"a": (0.5 * TOP, 0), "b": (TOP, 0)})
        by_name.step({"a": [0.5], "b": [1.0]})
        by_array.step([np.array([[[0.5], [1.0]]])])
        gears.step({"a": 1, "b": 2})
    assert speeds(plain) == speeds(by_name) == speeds(by_array) == speeds(gears)
    assert speeds(plain)[1] > speeds(plain)[0] > 1.0


@pytest.mark.parametrize(("adapter", "bad"), [(SpeedShare, ["x"]), (SpeedShare, [1.0, 2.0]), (Gears, 0.5)])
def test_what_is_no_element_of_the_space_is_refused(closing, adapter, bad):
    adapted = AgentSpec(interface=FAST, action_adapter=lambda share: (TOP * share, 0))
    env = closing(hiway_parallel_env(["loop"], {"a": FAST, "b": adapted}, adapter=adapter))
    env.reset(seed=1)
    actions = env._env.runner.actions
    with pytest.raises(ActionError):
        env.step({"a": bad, "b": 0.5})
    assert not actions.fresh.any()
    env.step({"a": 1 if adapter is Gears else [0.5], "b": 0.5})
    assert actions.values[0, :2, 0].tolist() == [10.0, 10.0]
