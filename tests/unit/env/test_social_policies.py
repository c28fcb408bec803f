"""Social policies: one call for all vehicles, what fails, what they remember."""

import dataclasses

import numpy as np
import pytest

from smarts.agents import (
    Agent,
    PooledAgents,
)
from smarts.agents.acting import InProcess, Request
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


def run_batches(agent, worlds, steps=20, policies=1, change=beside_both):
    """Run social agents of a class in some simulations; return the runner's parts and all transitions."""
    Batches.made = 0
    cast = Cast(tuple(policy_of(agent, number=0, observation=agent.observation) for _ in range(policies)))
    pool = [PooledAgents(LANER, 2)]
    parts = assemble([build_scenario("intersection")], [LANER], cast=cast, pool=pool, worlds=worlds)
    parts = dataclasses.replace(parts, schedule=Traffic(parts.schedule, change))
    runner = SimulationRunner(parts, [])
    try:
        runner.reset({row: EpisodeKey(row, 0, 42) for row in range(worlds)})
        runner.dispatch()
        transitions = []
        for _ in range(steps):
            transitions.append(runner.step())
            runner.dispatch()
        return parts, transitions, parts.simulation.world.vehicles.position.copy()
    finally:
        runner.close()


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
            self.batches.append(batch)
            drawn = [
                np.random.default_rng([seed, step]) for seed, step in zip(batch.seed, batch.step, strict=True)
            ]
            return np.array([generator.integers(2) for generator in drawn])

    together, alone = run_batches(Draws, 3, 40)[2], run_batches(Draws, 1, 40)[2]
    assert np.array_equal(together[0], alone[0])


@pytest.mark.parametrize("kind", ["raises", "number", "length"])
def test_what_a_batch_agent_answers_wrongly_fails_where_it_is_wrong(kind):
    class Fails(Batches):
        def act(self, batch):
            actions = np.zeros(len(batch.env_id))
            bad = batch.env_id == 1
            if kind == "raises" and bad.any():
                raise ValueError("simulation 1")
            actions[bad] = 9 if kind == "number" else 0
            return actions[1:] if kind == "length" else actions

    def only(agents):
        return beside(agents)

    _, transitions, _ = run_batches(Fails, 3, change=only)
    failed = transitions[0].social_failures
    assert [*failed] == ([1] if kind == "number" else [0, 1, 2])
    assert all([*names] == ["social"] for names in failed.values())
    assert not any(each.social_failures for each in transitions[1:])


def test_a_batch_agent_that_raises_is_not_asked_again():
    class Raises(Batches):
        def act(self, batch):
            self.batches.append(batch)
            raise SystemExit(3)

    def only(agents):
        return beside(agents)

    _, transitions, _ = run_batches(Raises, 3, change=only)
    assert [*transitions[0].social_failures] == [0, 1, 2]
    for named in transitions[0].social_failures.values():
        assert named["social"].startswith("raised SystemExit: 3 (")
    assert [batch.env_id.tolist() for batch in Raises.batches] == [[0, 1, 2]]


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


@pytest.mark.parametrize("options", [{}, {"is_boid": True}, {"is_boid": True, "keep_alive": True}])
def test_what_a_policy_remembers_ends_with_the_episode_whatever_its_number(options):
    class Counts(Agent):
        def __init__(self):
            self.asked = 0

        def act(self, obs):
            self.asked += 1
            return dict.fromkeys(obs, self.asked) if isinstance(obs, dict) else self.asked

    host = InProcess([policy_of(Counts, **options)])

    def asked(*env_ids, hold=0):
        host.dispatch({0: requests_of(*env_ids, hold=hold)})
        return [*host.gather()[0].actions]

    assert asked(0, 1) == [1, 1]
    assert asked(0, 1) == [2, 2]
    host.forget([1])
    assert asked(0, 1) == [3, 1], "the same hold and episode number"


def test_requests_in_flight_are_dropped_where_other_episodes_begin():
    seen = []
    host = InProcess([policy_of(lambda obs: seen.append(obs) or "keep_lane")])
    host.dispatch({0: requests_of(0, 1, 2)})
    host.forget([1])
    (answer,) = host.gather()
    assert answer.request.batch.env_id.tolist() == [0, 2]
    assert [*answer.request.vehicles] == ["car-0", "car-2"]
    assert seen == [0, 2]
    host.dispatch({0: requests_of(0)})
    host.forget([0])
    assert host.gather() == []


def test_an_episode_that_is_broken_off_is_not_asked_about(play):
    steps = []
    played = play(lambda seen: steps.append(seen.step_count) or "keep_lane", beside)
    played.reset()
    played.step(3)
    played.reset()
    played.step(2)
    assert steps == [0, 1, 2, 0, 1]


def test_failures_while_the_ego_waits_are_in_the_next_result(play):
    def waiting(agents):
        ego, social = beside(agents)
        return dataclasses.replace(ego, entry_time=3.0), social

    played = play(lambda seen: "fly", waiting)
    played.reset()
    assert played.world.step[0] >= 30
    assert [*played.step().social_failures[0]] == ["social"]
    assert played.step().social_failures == {}
    played.reset(1)
    assert [*played.runner.take_social_failures()[0]] == ["social"]
    assert played.step().social_failures == {}


def test_a_failed_policy_leaves_others_alone():
    class Fails(Batches):
        def act(self, batch):
            raise ValueError("never")

    cast = Cast(
        (
            policy_of(Fails, observation=Fails.observation),
            policy_of(Batches, observation=Batches.observation),
        )
    )
    parts = assemble([build_scenario("intersection")], [LANER], cast=cast, pool=[PooledAgents(LANER, 1)])

    def change(agents):
        ego, first, second = beside_both(agents)
        return ego, first, dataclasses.replace(second, policy=1)

    parts = dataclasses.replace(parts, schedule=Traffic(parts.schedule, change))
    runner = SimulationRunner(parts, [])
    try:
        runner.reset({0: EpisodeKey(0, 0, 42)})
        runner.dispatch()
        failed = {}
        for _ in range(20):
            failed |= runner.step().social_failures
            runner.dispatch()
        assert [*failed[0]] == ["social"]
        assert parts.actions.given[0].tolist() == [False, False, True]
    finally:
        runner.close()


def test_a_boid_whose_vehicles_decide_in_turns_stays_the_same():
    asked = []

    class Flock(Agent):
        made = 0

        def __init__(self):
            type(self).made += 1

        def act(self, obs):
            asked.append([*obs])
            return dict.fromkeys(obs, "keep_lane")

    def change(agents):
        ego, first, second = beside_both(agents)
        return ego, *(dataclasses.replace(each, period=2) for each in (first, second))

    cast = Cast((policy_of(Flock, is_boid=True, period=2),))
    parts = assemble([build_scenario("intersection")], [LANER], cast=cast, pool=[PooledAgents(LANER, 1)])
    runner = SimulationRunner(dataclasses.replace(parts, schedule=Traffic(parts.schedule, change)), [])
    try:
        runner.reset({0: EpisodeKey(0, 0, 42)})
        runner.dispatch()
        for _ in range(20):
            runner.step()
            runner.dispatch()
    finally:
        runner.close()
    assert asked[-5:-1] == [["second"], ["social"], ["second"], ["social"]]
    assert Flock.made == 1


@pytest.mark.parametrize(("enters", "made"), [(8, 1), (14, 2)])
def test_a_boid_that_has_lost_its_vehicles_is_another_agent_next_time(enters, made):
    """The first vehicle decides at steps 0 and 10, and leaves at step 12 or before."""
    asked = []

    class Flock(Agent):
        made = 0

        def __init__(self):
            type(self).made += 1

        def act(self, obs):
            asked.append([*obs])
            return dict.fromkeys(obs, "keep_lane")

    def change(agents):
        ego, first, second = beside_both(agents)
        first, second = (dataclasses.replace(each, period=10) for each in (first, second))
        return ego, first, dataclasses.replace(second, entry_time=0.1 * enters)

    brief = dataclasses.replace(LANER, max_episode_steps=12)
    cast = Cast((policy_of(Flock, brief, is_boid=True, period=10),))
    parts = assemble([build_scenario("intersection")], [LANER], cast=cast, pool=[PooledAgents(brief, 1)])
    runner = SimulationRunner(dataclasses.replace(parts, schedule=Traffic(parts.schedule, change)), [])
    try:
        runner.reset({0: EpisodeKey(0, 0, 42)})
        runner.dispatch()
        for _ in range(30):
            runner.step()
            runner.dispatch()
    finally:
        runner.close()
    assert asked[0] == ["social"]
    assert ["second"] in asked
    assert Flock.made == made


@pytest.mark.parametrize(("second", "keep_alive"), [(1, False), (0, True)])
def test_a_boid_gets_and_returns_dicts_by_the_vehicles_names(second, keep_alive):
    seen = []

    class Flock(Agent):
        made = 0

        def __init__(self):
            type(self).made += 1

        def act(self, obs):
            seen.append({name: each.step_count for name, each in obs.items()})
            return {name: "keep_lane" for name in obs if name != "second" or len(seen) < 15}

    policy = policy_of(Flock, is_boid=True, keep_alive=keep_alive)
    parts = assemble(
        [build_scenario("intersection")], [LANER], cast=Cast((policy,)), pool=[PooledAgents(LANER, 1)]
    )
    parts = dataclasses.replace(parts, schedule=Traffic(parts.schedule, beside_both))
    runner = SimulationRunner(parts, [])
    failed = {}
    try:
        for episode in (0, second):
            runner.reset({0: EpisodeKey(0, episode, 42)})
            runner.dispatch()
            for _ in range(20):
                failed |= runner.step().social_failures.get(0, {})
                runner.dispatch()
    finally:
        runner.close()
    assert Flock.made == 2, "one in an episode"
    assert [*seen[0]] == ["social"]
    assert [*seen[13]] == ["social", "second"]
    assert [*failed] == ["second"]
