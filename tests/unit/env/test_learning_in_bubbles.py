"""Agents that learn in bubbles: columns are a pool, leaving truncates, time ends episodes."""

from pathlib import Path

import numpy as np
import pytest
from shapely import Point, Polygon

from algorithms.joint.conformance import check_vector_env
from smarts.agents.benchmark import benchmark_interface
from smarts.agents.options import InterfaceError
from smarts.env import (
    HiWayEnv,
    PyMARLEnv,
    RLlibHiWayEnv,
    SingleHiWayEnv,
    SingleHiWayVectorEnv,
    VectorHiWayEnv,
    hiway_parallel_env,
)
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Event, Outcome
from smarts.types.vehicles import Owner

LEFT_TURN = Path(__file__).parents[3] / "examples" / "left_turn_bubble"
IN_BUBBLE = {"learn_in_bubbles": True, "episode_time": 40.0}
BUS = benchmark_interface(vehicle_class="bus")


def vector(worlds=1, agents=3, **options):
    return VectorHiWayEnv(worlds, [LEFT_TURN], agents=agents, **{**IN_BUBBLE, **options})


def copied(step):
    """Return the last observations, copied."""
    return {name: array.copy() for name, array in step.observations[0].items()}


@pytest.fixture(scope="module")
def played():
    """Play two simulations of two agents; return what each decision led to."""
    env = vector(2, 2)
    try:
        step, moments = env.reset(5), []
        agents, pool = env._runner.world.agents, env._runner._pool
        for _ in range(250):
            acted, holds = step.alive.copy(), pool.serial[:, :2].copy()
            step = env.step([np.zeros((2, 2), int)])
            moments.append(
                {
                    "acted": acted,
                    "alive": step.alive.copy(),
                    "terminated": step.terminated.copy(),
                    "truncated": step.truncated.copy(),
                    "rewards": step.rewards.copy(),
                    "reset": step.reset.copy(),
                    "seen": copied(step),
                    "outcome": agents.outcome[:, :2].copy(),
                    "drivers": drivers(env),
                    "holds": holds,
                    "holds_now": pool.serial[:, :2].copy(),
                    "step": env._runner.world.step.copy(),
                    "metrics": dict(step.metrics),
                    "events": env._runner._events.copy(),
                }
            )
        return moments
    finally:
        env.close()


def test_leaving_the_bubble_truncates_with_the_last_observation_in_place(played):
    left = 0
    for moment in played:
        for row, column in np.argwhere(moment["truncated"] & ~moment["reset"][:, None]).tolist():
            assert moment["outcome"][row, column] == Outcome.LEFT_BUBBLE
            assert moment["events"][row, column] & Event.LEFT_BUBBLE
            assert not moment["alive"][row, column]
            assert moment["acted"][row, column]
            assert any(array[row, column].any() for array in moment["seen"].values())
            assert moment["holds"][row, column] == moment["holds_now"][row, column], "not yet reused"
            left += 1
    assert left > 10


def test_a_column_is_used_again_after_the_decision_was_returned(played):
    ended, again = np.zeros((2, 2), bool), 0
    for moment in played:
        again += np.count_nonzero(ended & moment["alive"] & ~moment["reset"][:, None])
        ended = (ended | moment["terminated"] | moment["truncated"]) & ~moment["alive"]
        ended &= ~moment["reset"][:, None]
    assert again > 5


def test_only_agents_that_acted_end_and_are_rewarded(played):
    for moment in played:
        idle = ~moment["acted"]
        assert not (moment["terminated"] | moment["truncated"])[idle].any()
        assert not moment["rewards"][idle].any()
        gone = moment["acted"] & ~moment["alive"] & ~moment["reset"][:, None]
        assert (moment["terminated"] | moment["truncated"])[gone].all()


def test_time_ends_episodes_and_an_empty_bubble_does_not(played):
    empty = 0
    for moment in played:
        empty += np.count_nonzero(~moment["alive"].any(axis=1) & ~moment["reset"])
        for row in np.flatnonzero(moment["reset"]).tolist():
            assert moment["metrics"][row]["steps"] == 400
            driving = moment["acted"][row]
            ended = moment["terminated"][row] | moment["truncated"][row]
            assert np.array_equal(ended, driving)
    assert empty, "a decision in which the last agent ended"
    shares = [shares for moment in played for shares in moment["metrics"].values()]
    assert shares
    assert any(share["left_bubble"] > 0 for share in shares)
    assert any(share["time_out"] > 0 for share in shares)


def drivers(env):
    """Return the owner, the state of its agent (-1: none) and the distance from the zone of each vehicle."""
    runner, found = env._runner, []
    world = runner.world
    vehicles, agents = world.vehicles, world.agents
    for row, slot in np.argwhere(vehicles.alive).tolist():
        (zone,) = runner.starts[row].bubbles[0].zone
        heading, half = vehicles.heading[row, slot], vehicles.length[row, slot] / 2
        front = vehicles.position[row, slot] + half * np.array([np.cos(heading), np.sin(heading)])
        holders = np.flatnonzero(agents.slot[row] == slot)
        state = int(agents.state[row, holders[0]]) if len(holders) else -1
        found.append((int(vehicles.owner[row, slot]), state, Polygon(zone).distance(Point(front))))
    return found


def test_agents_drive_the_vehicles_in_the_zone_and_traffic_all_others(played):
    found = [each for moment in played for each in moment["drivers"]]
    for owner, state, distance in found:
        is_driven = state in (AgentStatus.ACTIVE, AgentStatus.DONE, AgentStatus.LEAVING)
        assert owner == (Owner.AGENT if is_driven else Owner.TRAFFIC)
        assert state != AgentStatus.ACTIVE or distance == 0
    assert sum(owner == Owner.TRAFFIC and distance > 0 for owner, _, distance in found) > 100
    assert sum(state == AgentStatus.ACTIVE for _, state, _ in found) > 100


def test_the_contract_of_vector_environments():
    env = vector(2)
    try:
        check_vector_env(env, steps=120, seed=3)
    finally:
        env.close()


def test_a_row_of_a_batch_equals_the_run_alone():
    results = []
    for worlds in (3, 1):
        env = vector(worlds)
        try:
            step, found = env.reset(9), []
            for _ in range(60):
                step = env.step([np.zeros((worlds, 3), int)])
                found.append((step.alive[0].copy(), step.rewards[0].copy(), step.observations[0]))
                found[-1] = (*found[-1][:2], {name: array[0].copy() for name, array in found[-1][2].items()})
            results.append(found)
        finally:
            env.close()
    for (alive, rewards, seen), (alive_1, rewards_1, seen_1) in zip(*results, strict=True):
        assert np.array_equal(alive, alive_1)
        assert np.array_equal(rewards, rewards_1)
        assert all(np.array_equal(seen[name], seen_1[name]) for name in seen)


def test_by_names_agents_end_and_appear_again():
    names = [f"a{number}" for number in range(3)]
    specs = {name: benchmark_interface() for name in names}
    env = HiWayEnv([LEFT_TURN], specs, decision_interval=5, **IN_BUBBLE)
    try:
        observations, _ = env.reset(seed=1)
        assert observations, "an episode begins with an agent"
        driving, ended, again, over = set(observations), set(), 0, False
        while not over:
            observations, _, terminated, truncated, infos = env.step(dict.fromkeys(driving, "keep_lane"))
            over = terminated["__all__"]
            assert not (truncated["__all__"] and not over)
            for name, seen in observations.items():
                done = terminated[name] or truncated[name]
                if done:
                    assert infos[name]["outcome"] in ("left_bubble", "collision", "time_out")
                again += name in ended and name not in driving
                ended |= {name} if done else set()
                assert seen.ego_vehicle_state is not None
            driving = {name for name in observations if not (terminated[name] or truncated[name])}
        assert again
    finally:
        env.close()


@pytest.mark.parametrize(
    ("options", "place"),
    [
        ({"scenarios": ["loop"], **IN_BUBBLE}, "learn_in_bubbles"),
        ({"learn_in_bubbles": True}, "episode_time"),
        ({"episode_time": 20.0}, "episode_time"),
        ({"learn_in_bubbles": "left-turn", "episode_time": 20.0}, "learn_in_bubbles"),
        ({"learn_in_bubbles": ["left-trun"], "episode_time": 20.0}, "learn_in_bubbles"),
        ({**IN_BUBBLE, "agents": {"a": benchmark_interface(), "b": BUS}}, "learn_in_bubbles"),
    ],
)
def test_what_is_no_learning_in_bubbles(options, place):
    with pytest.raises(InterfaceError) as error:
        VectorHiWayEnv(1, **{"scenarios": [LEFT_TURN], "agents": 2, **options})
    assert error.value.place == place


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"action": ActionSpaceType.Empty}, "Empty"),
        ({"vehicle_class": "bus"}, "bus"),
    ],
)
def test_agents_that_cannot_drive_the_vehicles_of_a_bubble(changes, said):
    with pytest.raises(InterfaceError) as error:
        HiWayEnv([LEFT_TURN], {"turner": benchmark_interface(**changes)}, **IN_BUBBLE)
    assert "'left-turn'" in error.value.place
    assert said in error.value.problem


@pytest.mark.parametrize(
    "make",
    [
        lambda: hiway_parallel_env([LEFT_TURN], 2, **IN_BUBBLE),
        lambda: RLlibHiWayEnv({"scenarios": [LEFT_TURN], "agents": 2, **IN_BUBBLE}),
        lambda: SingleHiWayEnv([LEFT_TURN], **IN_BUBBLE),
        lambda: SingleHiWayVectorEnv(1, [LEFT_TURN], **IN_BUBBLE),
        lambda: PyMARLEnv([LEFT_TURN], 2, **IN_BUBBLE),
    ],
)
def test_environments_whose_agents_do_not_begin_again(make):
    with pytest.raises(InterfaceError) as error:
        make()
    assert "learn_in_bubbles" in error.value.problem
