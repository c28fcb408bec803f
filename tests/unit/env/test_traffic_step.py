"""Environments with a longer step of the traffic, or with Native: a row of a batch equals the run alone."""

from contextlib import closing

import numpy as np
import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.env import HiWayEnv, RLlibHiWayEnv, hiway_parallel_env
from smarts.env.vector import VectorHiWayEnv
from smarts.sim.assembly import Options
from smarts.types.streams import Purpose, stream


def play(worlds, step, decisions=110):
    """Return the observations and rewards of world 3, whose row is the last, by decision."""
    env = VectorHiWayEnv(
        len(worlds),
        ["two_way"],
        2,
        traffic=["random_social_vehicles"],
        simulation=Options(traffic_step=step),
    )
    generator, found = stream(5, Purpose.STARTS), []
    with closing(env):
        now = env.reset(7, np.array(worlds))
        for _ in range(decisions):
            found.append((now.observations[0][""][-1].copy(), now.rewards[-1].copy(), now.reset[-1]))
            actions = generator.integers(0, 2, 2)
            now = env.step([np.tile(actions, (len(worlds), 1))])
    return found


def test_a_row_of_a_batch_equals_the_run_alone():
    alone, beside = play([3], 0.5), play([8, 1, 3], 0.5)
    assert any(reset for _, _, reset in alone), "over episodes"
    for one, other in zip(alone, beside, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_step_of_the_worlds_length_changes_nothing():
    for one, other in zip(play([3], None, 10), play([3], 0.1, 10), strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    "make",
    [
        lambda options: HiWayEnv(["two_way"], {"agent-0": benchmark_interface()}, simulation=options),
        lambda options: hiway_parallel_env(["two_way"], 1, simulation=options),
        lambda options: RLlibHiWayEnv({"scenarios": ["two_way"], "agent_specs": 1, "simulation": options}),
    ],
    ids=["HiWayEnv", "ParallelEnv", "RLlib"],
)
def test_every_environment_api_has_native_traffic(make):
    with closing(make(Options(traffic_engine="Native"))) as env:
        env.reset(seed=1)
        runner = env._env.runner
        assert runner.starts[0].engine == "Native"
        before = int(runner.world.vehicles.alive.sum())
        for _ in range(5):
            assert env.step({"agent-0": 0})[1].keys() >= {"agent-0"}
        assert before > 1
