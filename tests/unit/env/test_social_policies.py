"""Social policies: one call for all vehicles, what fails, what they remember."""

import dataclasses
from contextlib import closing

import numpy as np
import pytest

from smarts.agents import (
    Agent,
    PooledAgents,
)
from smarts.agents.acting import Request
from smarts.agents.hosting.hosts import Hosts
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.agents.social import Cast
from smarts.env.runner import EpisodeKey, SimulationRunner
from smarts.sim.assembly import assemble
from smarts.sstudio.build import build_scenario
from smarts.types.streams import hold_seed
from tests.unit.env.social_stage import (
    LANER,
    Traffic,
    beside,
    policy_of,
    start_of,
)


class Batches(BatchAgent):
    """Drives by numbers of lane actions."""

    observation = ("speed",)
    made, batches = 0, []

    def __init__(self):
        type(self).made += 1
        self.batches.clear()

    def act(self, batch):
        self.batches.append(batch)
        return np.zeros(len(batch.env_id), int)


def beside_both(agents):
    """Let two social agents enter with the ego."""
    later = dataclasses.replace(
        agents[0], name="second", interface=0, policy=0, entry_time=1.0, pose=start_of(2)
    )
    return (*beside(agents), later)


def run(policies, change=beside_both, *, worlds=1, steps=20, episodes=(0,), interface=LANER):
    """Run the social agents of some policies; return the parts, and each step's failures by simulation."""
    parts = assemble(
        [build_scenario("intersection")],
        [LANER],
        cast=Cast(tuple(policies)),
        pool=[PooledAgents(interface, 2)],
        worlds=worlds,
    )
    runner = SimulationRunner(dataclasses.replace(parts, schedule=Traffic(parts.schedule, change)), [])
    failures = []
    with closing(runner):
        for episode in episodes:
            runner.reset({row: EpisodeKey(row, episode, 42) for row in range(worlds)})
            runner.dispatch()
            for _ in range(steps):
                runner.step()
                failures.append(runner.take_social_failures())
                runner.dispatch()
        return parts, failures


def run_batches(agent, worlds, **options):
    Batches.made = 0
    return run([policy_of(agent, observation=agent.observation)], worlds=worlds, **options)


def test_one_policy_serves_all_vehicles_of_all_simulations_by_one_call():
    run_batches(Batches, 3)
    assert Batches.made == 1
    first = Batches.batches[0]
    last = max(Batches.batches, key=lambda batch: len(batch.env_id))
    count = len(last.env_id)
    assert first.env_id.tolist() == [0, 1, 2]
    assert first.agent_id.tolist() == [1, 1, 1]
    assert first.is_first.all()
    places = [*zip(last.env_id.tolist(), last.agent_id.tolist(), strict=True)]
    assert len({*places}) == count > 3
    assert places == sorted(places)
    assert len({*last.hold.tolist()}) == 2
    assert last.observations["observation"].shape == (count, 1)
    assert last.action_mask.shape == (count, 4)
    assert len(set(last.seed.tolist())) == count
    assert first.seed[1] == hold_seed(42, "social", world=1)
    assert set(last.step.tolist()) == {int(last.step[0])}


def test_a_row_of_a_batch_equals_the_run_alone():
    class Draws(Batches):
        def act(self, batch):
            draws = zip(batch.seed, batch.step, strict=True)
            return np.array([np.random.default_rng([seed, step]).integers(2) for seed, step in draws])

    together, alone = (
        run_batches(Draws, worlds, steps=40)[0].simulation.world.vehicles.position[0] for worlds in (3, 1)
    )
    assert np.array_equal(together, alone)


@pytest.mark.parametrize("kind", ["raises", "number", "length"])
def test_what_a_batch_agent_answers_wrongly_fails_where_it_is_wrong(kind):
    class Fails(Batches):
        def act(self, batch):
            self.batches.append(batch)
            actions = np.zeros(len(batch.env_id))
            bad = batch.env_id == 1
            if kind == "raises" and bad.any():
                raise SystemExit(3)
            actions[bad] = 9 if kind == "number" else 0
            return actions[1:] if kind == "length" else actions

    _, failures = run_batches(Fails, 3, change=beside)
    failed = [1] if kind == "number" else [0, 1, 2]
    assert [*failures[0]] == failed
    for named in failures[0].values():
        assert kind != "raises" or named["social"].startswith("raised SystemExit: 3 (")
    assert not any(failures[1:])
    assert not {*failed} & {row for batch in Fails.batches[1:] for row in batch.env_id.tolist()}, "not again"


def requests_of(*env_ids, hold=0):
    """Return a request for one vehicle in each of some simulations."""
    count = len(env_ids)
    zeros = np.zeros(count, np.int32)
    batch = ActionBatch(
        {},
        np.ones((count, 4), bool),
        np.array(env_ids, np.int32),
        zeros,
        np.arange(hold, hold + count),
        zeros,
        zeros,
        np.ones(count, bool),
        np.zeros(count, np.uint64),
        np.ones(count, bool),
    )
    names = [f"car-{env_id}" for env_id in env_ids]
    return Request(batch, [*env_ids], names, [*zip(env_ids, batch.hold.tolist(), strict=True)])


@pytest.mark.parametrize("options", [{}, {"is_boid": True, "keep_alive": True}])
def test_what_a_policy_remembers_ends_with_the_episode_whatever_its_number(options):
    class Counts(Agent):
        def __init__(self):
            self.asked = 0

        def act(self, obs):
            self.asked += 1
            return dict.fromkeys(obs, self.asked) if isinstance(obs, dict) else self.asked

    host = Hosts([policy_of(Counts, **options)])

    def asked(*env_ids, hold=0):
        host.dispatch({0: requests_of(*env_ids, hold=hold)})
        return [*host.gather()[0].actions]

    assert asked(0, 1) == [1, 1]
    assert asked(0, 1) == [2, 2]
    host.forget([1])
    assert asked(0, 1) == [3, 1], "the same hold and episode number"


def test_requests_in_flight_are_dropped_where_other_episodes_begin():
    seen = []
    host = Hosts([policy_of(lambda obs: seen.append(obs) or "keep_lane")])
    host.dispatch({0: requests_of(0, 1, 2)})
    host.forget([1])
    (answer,) = host.gather()
    assert answer.request.batch.env_id.tolist() == [0, 2]
    assert [*answer.request.vehicles] == ["car-0", "car-2"]
    assert seen == [0, 2]
    host.dispatch({0: requests_of(0)})
    host.forget([0])
    assert host.gather() == []


def flock(period=1, act=lambda obs: dict.fromkeys(obs, "keep_lane"), interface=LANER, **options):
    """Return the policy of a boid, its class, and the lists of vehicles that it was asked about."""
    asked = []

    class Flock(Agent):
        made = 0

        def __init__(self):
            type(self).made += 1

        def act(self, obs):
            asked.append([*obs])
            return act(obs)

    return policy_of(Flock, interface, is_boid=True, period=period, **options), Flock, asked


@pytest.mark.parametrize(("second", "keep_alive"), [(1, False), (0, True)])
def test_a_boid_gets_and_returns_dicts_by_the_vehicles_names(second, keep_alive):
    def act(obs):
        return {name: "keep_lane" for name in obs if name != "second" or len(asked) < 15}

    policy, kind, asked = flock(act=act, keep_alive=keep_alive)
    _, failures = run([policy], episodes=(0, second))
    assert kind.made == 2, "one in an episode"
    assert asked[0] == ["social"]
    assert asked[13] == ["social", "second"]
    assert {name for each in failures for named in each.values() for name in named} == {"second"}
