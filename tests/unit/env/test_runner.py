"""The loop: rows equal runs of their own, decisions hold, failures stay where they are."""

import numpy as np
import pytest
import torch

from smarts.agents import AgentInterface, DoneCriteria, EventConfiguration
from smarts.env.vector import VectorHiWayEnv
from smarts.errors import ActionError, SmartsError
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.agent_states import ChangePhase
from smarts.types.events import Outcome
from tests.raising import raises

KEEP, SLOW, LEFT, RIGHT = LaneAction


@pytest.fixture
def new_env():
    made = []

    def make(*args, **options):
        made.append(VectorHiWayEnv(*args, **options))
        return made[-1]

    yield make
    for env in made:
        env.close()


def actions_of(world, decision, agents=4):
    """Return actions that depend on world, decision and agent only."""
    draws = np.random.Generator(np.random.PCG64(world * 1000 + decision))
    return draws.choice([KEEP, SLOW, LEFT, RIGHT], size=agents)


def play(env, worlds, decisions, episode=0):
    """Return for each world the observations, rewards and ends of some decisions, auto-resets included."""
    now = env.reset(7, np.array(worlds), episode=episode)
    seen = [[now.observations[0][""][row].tobytes()] for row in range(len(worlds))]
    for decision in range(decisions):
        now = env.step([np.array([actions_of(world, decision) for world in worlds])])
        for row in range(len(worlds)):
            parts = (
                now.observations[0][""],
                now.rewards,
                now.terminated,
                now.truncated,
                now.alive,
                now.masks[0],
            )
            seen[row].append(b"".join(part[row].tobytes() for part in parts))
    return seen


SCENARIOS = ["intersection", "double_merge"]


def test_rows_of_a_batch_equal_runs_of_their_own(new_env):
    env = new_env(3, SCENARIOS)
    together = play(env, [0, 1, 2], 0)
    assert {start.scenario for start in env.episodes} == set(SCENARIOS), "they are not side by side"
    together = play(env, [0, 1, 2], 60)
    alone = new_env(1, SCENARIOS)
    for world in (0, 1, 2):
        assert play(alone, [world], 60)[0] == together[world]


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


def test_a_held_lane_change_is_carried_out_once(new_env):
    env = new_env(1, ["double_merge"], 1)
    for episode in range(8):
        now = env.reset(3, episode=episode)
        for _ in range(40):
            lane = LEFT if now.masks[0][0, 0, LEFT] else RIGHT if now.masks[0][0, 0, RIGHT] else None
            if lane is not None:
                return _change_once(env, lane)
            now = env.step([np.array([[KEEP]])])
            if now.reset[0]:
                break
    pytest.fail("no lane change was ever legal")


def _change_once(env, change):
    """The action holds for the five steps of the decision, and is carried out in the first of them."""
    world = env._runner.world
    before = int(world.agents.target_lane[0, 0])
    env.step([np.array([[change]])])
    assert world.agents.effective[0, 0]
    target = int(world.agents.target_lane[0, 0])
    assert target != before
    assert world.agents.change_phase[0, 0] in (ChangePhase.REQUESTED, ChangePhase.MOVING)
    for _ in range(8):
        env.step([np.array([[KEEP]])])
        assert world.agents.target_lane[0, 0] == target


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


def test_actions_out_of_range_are_refused_by_name(new_env):
    env = new_env(1, ["two_way"], 2)
    env.reset()
    for value in (4, -1):
        with raises(ActionError, "action of 'agent-1'", values=[value]):
            env.step([np.array([[0, value]])])
    env.step([np.array([[0, 0]])])


@pytest.mark.parametrize(
    "actions",
    [
        *(0, torch.zeros((2, 1, 2), dtype=int), {0: np.zeros((1, 2), int)}),
        *([np.zeros((1, 3), int)], [np.zeros(2, int)], [[[0, 1], [0]]], [[["a", "b"]]]),
    ],
    ids=["a number", "two blocks", "a dict", "three agents", "no rows", "ragged", "texts"],
)
def test_actions_of_another_shape_are_refused(new_env, actions):
    env = new_env(1, ["two_way"], 2)
    with raises(SmartsError, "step", values=["reset()"]):
        env.step([np.zeros((1, 2), int)])
    env.reset()
    with pytest.raises(ActionError):
        env.step(actions)
    assert env._runner.world.step[0] == 0
    env.close()
    with raises(SmartsError, "SimulationRunner"):
        env.step([np.zeros((1, 2), int)])


@pytest.mark.parametrize("array", [np.array, torch.tensor], ids=["numpy", "torch"])
def test_blocks_are_a_list_or_stacked(new_env, array):
    env = new_env(1, ["two_way"], 2)
    seen = []
    for actions in ([array([[SLOW, KEEP]])], (array([[SLOW, KEEP]]),), array([[[SLOW, KEEP]]])):
        env.reset(1)
        seen.append(env.step(actions).observations[0][""].tobytes())
    assert len(set(seen)) == 1


def test_stride_deals_out_a_list_of_worlds(new_env):
    env = new_env(2, ["two_way"])
    now = env.reset(5, np.array([0, 1]), episode=3, stride=2)
    for _ in range(300):
        now = env.step([np.full((2, 4), KEEP)])
        if now.reset.any():
            break
    row = int(np.flatnonzero(now.reset)[0])
    assert (env.episodes[row].world, env.episodes[row].episode) == (row + 2, 3)


@pytest.mark.parametrize(("time", "outcome"), [(1.0, "not_moving"), (np.inf, "time_out")])
def test_who_may_rest_for_ever(new_env, time, outcome):
    resting = EventConfiguration(not_moving_time=time)
    interface = AgentInterface(
        action=ActionSpaceType.Lane,
        max_episode_steps=150,
        done_criteria=DoneCriteria(not_moving=True),
        event_configuration=resting,
    )
    env = new_env(1, ["loop"], {"a": interface})
    now = env.reset(1)
    while not now.reset.any():
        now = env.step([np.array([[SLOW]])])
    assert now.metrics[0][outcome] == 1.0
