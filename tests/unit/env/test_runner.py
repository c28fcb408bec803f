"""The loop: rows equal runs of their own, decisions hold, failures stay where they are."""

import numpy as np
import pytest

from smarts.env.vector import VectorHiWayEnv
from smarts.types.actions import LaneAction
from smarts.types.events import Outcome

KEEP, SLOW, LEFT, RIGHT = LaneAction


@pytest.fixture
def new_env(closing):
    return lambda *args, **options: closing(VectorHiWayEnv(*args, **options))


SCENARIOS = ["intersection", "double_merge"]


def test_an_episode_does_not_depend_on_those_before(new_env):
    env = new_env(1, SCENARIOS)
    now = env.reset(7)
    episode = 0
    while episode < 2:
        now = env.step([np.full((1, 4), KEEP)])
        episode += int(now.reset[0])
    reached = [now.observations[0][""][0].tobytes()]
    reached += [env.step([np.full((1, 4), SLOW)]).observations[0][""][0].tobytes() for _ in range(5)]
    fresh = new_env(1, SCENARIOS)
    begun = [fresh.reset(7, episode=2).observations[0][""][0].tobytes()]
    begun += [fresh.step([np.full((1, 4), SLOW)]).observations[0][""][0].tobytes() for _ in range(5)]
    assert reached == begun


def test_finished_agents_are_zeros_after_their_last_observation(new_env):
    env = new_env(1, ["intersection"])
    now = env.reset(1)
    for _ in range(200):
        now = env.step([np.full((1, 4), KEEP)])
        ended = (now.terminated | now.truncated)[0]
        if ended.any() and not now.reset[0]:
            break
    else:
        pytest.fail("no agent ended before the others")
    seen = now.observations[0][""][0]
    assert seen[ended].any(axis=1).all()
    assert not now.alive[0, ended].any()
    after = env.step([np.full((1, 4), KEEP)])
    assert not after.reset[0]
    assert not after.observations[0][""][0, ended].any()
    assert not after.rewards[0, ended].any()


def test_final_observations_of_those_who_were_reset(new_env):
    env = new_env(2, ["two_way"])
    now = env.reset(1)
    for _ in range(300):
        now = env.step([np.full((2, 4), KEEP)])
        if now.reset.any():
            break
    assert now.final is not None
    np.testing.assert_array_equal(now.final.rows, np.flatnonzero(now.reset))
    assert now.final.observations[0][""].shape == (now.reset.sum(), 4, 203)
    assert set(now.metrics) == set(now.final.rows.tolist())
    shares = now.metrics[int(now.final.rows[0])]
    assert sum(shares.get(outcome.name.lower(), 0.0) for outcome in Outcome if outcome) == pytest.approx(1.0)
    row = int(now.final.rows[0])
    ended = (now.terminated | now.truncated)[row]
    assert now.final.observations[0][""][0, ended].any(axis=1).all()
    assert now.alive[row].all()


def test_stride_deals_out_a_list_of_worlds(new_env):
    env = new_env(2, ["two_way"])
    now = env.reset(5, np.array([0, 1]), episode=3, stride=2)
    for _ in range(300):
        now = env.step([np.full((2, 4), KEEP)])
        if now.reset.any():
            break
    row = int(np.flatnonzero(now.reset)[0])
    assert (env.episodes[row].world, env.episodes[row].episode) == (row + 2, 3)
