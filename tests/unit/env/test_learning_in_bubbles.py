"""Agents that learn in bubbles: columns are a pool, leaving truncates, time ends episodes."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from shapely import Point, Polygon

from smarts.agents.options import InterfaceError
from smarts.env import (
    VectorHiWayEnv,
)
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Event, Outcome
from smarts.types.vehicles import Owner
from tests.vector_contract import check_vector_env

LEFT_TURN = Path(__file__).parents[3] / "examples" / "left_turn_bubble"
IN_BUBBLE = {"learn_in_bubbles": True, "episode_time": 40.0}


def vector(worlds=1, agents=3, **options):
    return VectorHiWayEnv(worlds, [LEFT_TURN], agents=agents, **{**IN_BUBBLE, **options})


def copied(step):
    """Return the last observations, copied."""
    return {name: array.copy() for name, array in step.observations[0].items()}


@pytest.fixture(scope="module")
def played():
    """Play two simulations of two agents; return what each decision led to."""
    with closing(vector(2, 2)) as env:
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
    with closing(vector(2)) as env:
        check_vector_env(env, steps=120, seed=3)


@pytest.mark.parametrize(
    ("options", "place"),
    [
        ({"scenarios": ["loop"], **IN_BUBBLE}, "learn_in_bubbles"),
        ({"learn_in_bubbles": True}, "episode_time"),
        ({"learn_in_bubbles": ["left-trun"], "episode_time": 20.0}, "learn_in_bubbles"),
    ],
)
def test_what_is_no_learning_in_bubbles(options, place):
    with pytest.raises(InterfaceError) as error:
        VectorHiWayEnv(1, **{"scenarios": [LEFT_TURN], "agents": 2, **options})
    assert error.value.place == place
