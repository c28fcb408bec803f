"""Social agents through the runner: requests by policy, failures, transfers of vehicles."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from smarts.agents import (
    ActionSpaceType,
    Agent,
    AgentInterface,
    AgentPolicy,
    AgentSpec,
    DoneCriteria,
    PooledAgents,
)
from smarts.agents.acting import Answer, InProcess, Request
from smarts.agents.options import InterfaceError
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.agents.social import Cast, SocialPolicy
from smarts.env.runner import EpisodeKey, SimulationRunner
from smarts.errors import ScenarioError
from smarts.sim.assembly import assemble
from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import AgentStart, TakeOver
from smarts.types.mission import AgentMission
from smarts.types.streams import hold_seed
from smarts.types.transfers import Reason, Refusal, Transfer, transfers
from smarts.types.vehicles import Owner
from tests.raising import raises

LANER = AgentInterface(action=ActionSpaceType.Lane, done_criteria=DoneCriteria())
EGO, SOCIAL = 0, 1


def keep(seen):
    return "keep_lane"


def policy_of(act, interface=LANER, number=0, **options):
    """Return a policy that acts by a function of an observation, or the class of an agent."""
    build = act if isinstance(act, type) else lambda: AgentPolicy.from_function(act)
    return SocialPolicy("social", "tests:social-v0", AgentSpec(interface, build), number, **options)


class Answers:
    """A host whose answers arrive when the test says so."""

    def __init__(self):
        self.asked, self.ready = [], []

    def begin(self):
        pass

    def dispatch(self, requests):
        self.asked += [(number, request) for number, request in requests.items()]

    def gather(self):
        ready, self.ready = self.ready, []
        return ready

    def forget(self, rows):
        self.forgotten = [*rows]

    def close(self):
        self.ready = None


class Traffic:
    """A schedule that plays the first of its episodes with traffic, its starts changed."""

    def __init__(self, schedule, change):
        self._schedule, self._change = schedule, change

    def start(self, world, episode, seed=None):
        numbers = range(episode, episode + 20)
        starts = (self._schedule.start(world, number, seed) for number in numbers)
        start = next(start for start in starts if start.traffic.warm_up)
        return dataclasses.replace(start, episode=episode, agents=self._change(start.agents), room=None)


class Played:
    """One ego and a social agent on the intersection."""

    def __init__(
        self, acting=keep, change=lambda agents: agents, *, social=LANER, egos=1, scenario=None, **options
    ):
        scenarios = [build_scenario(scenario or "intersection")]
        host = acting if isinstance(acting, Answers) else None
        policies = [policy_of(keep if host else acting, social)]
        parts = assemble(scenarios, [LANER] * egos, cast=Cast(tuple(policies)))
        self.parts = dataclasses.replace(parts, schedule=Traffic(parts.schedule, change))
        self.runner = SimulationRunner(self.parts, [], host=host, **options)
        self.world, self.agent_id = parts.simulation.world, egos

    def reset(self, episode=0):
        self.runner.reset({0: EpisodeKey(0, episode, 42)})
        self.runner.dispatch()

    def step(self, steps=1):
        transitions = []
        for _ in range(steps):
            transitions.append(self.runner.step())
            self.runner.dispatch()
        return transitions[-1]

    @property
    def slot(self):
        return int(self.world.agents.slot[0, self.agent_id])


@pytest.fixture
def play():
    made = []

    def make(*arguments, **options):
        made.append(Played(*arguments, **options))
        return made[-1]

    yield make
    for one in made:
        one.runner.close()


def beside(agents):
    """Let a social agent enter with the ego."""
    social = dataclasses.replace(
        agents[0], name="social", interface=0, policy=0, pose=start_of(1), entry_time=0.0
    )
    return (*agents, social)


def trap(patience=50.0, agent_id=SOCIAL):
    """Let the ego, or a social agent, wait for a vehicle of traffic."""

    def change(agents):
        interface, rule = agent_id - SOCIAL, TakeOver(patience=patience)
        waiting = dataclasses.replace(
            agents[0], name="social", interface=interface, policy=interface, take_over=rule
        )
        return (*agents[:agent_id], waiting, *agents[agent_id + 1 :])

    return change


@cache
def start_of(ego):
    """Return where another ego of the scenario would begin, far from the first."""
    schedule = assemble([build_scenario("intersection")], [LANER] * 3)
    try:
        return schedule.schedule.start(0, 0).agents[ego].pose
    finally:
        schedule.simulation.close()


def test_a_social_agent_drives_as_its_policy_says(play):
    seen = []

    class Brakes(Agent):
        made = 0

        def __init__(self):
            Brakes.made += 1

        def act(self, obs):
            seen.append(obs)
            return "slow_down"

    played = play(Brakes, beside)
    assert Brakes.made == 0
    played.reset()
    vehicle = played.slot
    assert played.world.vehicles.owner[0, vehicle] == Owner.AGENT
    start_speed = float(played.world.vehicles.speed[0, vehicle])
    played.step(30)
    assert Brakes.made == 1
    assert len(seen) == 30
    assert seen[0].ego_vehicle_state.position[:2] == pytest.approx(start_of(1)[:2], abs=1e-6)
    assert played.world.vehicles.speed[0, vehicle] < min(start_speed, 0.5) + 0.1
    played.reset(1)
    played.step(2)
    assert Brakes.made == 2, "the next episode's agent is another"


def test_answers_of_the_past_are_dropped(play):
    answers = Answers()
    played = play(answers, beside)
    played.reset()
    ((number, first),) = answers.asked
    assert (number, first.batch.hold.tolist(), first.batch.is_first.tolist()) == (0, [2], [True])
    played.step()
    assert not played.runner.actions.given[0, SOCIAL], "no answer has come"
    answers.ready = [Answer(0, answers.asked[-1][1], ["slow_down"])]
    played.step()
    assert played.runner.actions.given[0, SOCIAL]
    assert played.runner.actions.values[0, SOCIAL, 0] == 1
    assert not answers.asked[-1][1].batch.is_first[0]
    last = answers.asked[-1][1]
    played.reset(1)
    answers.ready = [Answer(0, last, ["keep_lane"])]
    played.step()
    assert not played.runner.actions.given[0, SOCIAL], "an answer of the last episode"


@pytest.mark.parametrize(
    ("action", "told"),
    [("fly", "fly"), (float("nan"), "nan"), (7, "7"), ([1, 2], "1"), (None, "None"), (object, "object")],
)
def test_an_agent_whose_answer_is_no_action_fails_alone(play, action, told):
    asked = []
    played = play(lambda seen: asked.append(seen) or (action if len(asked) > 3 else "keep_lane"), beside)
    played.reset()
    transition = played.step(3)
    assert transition.social_failures == {}
    transition = played.step()
    assert [*transition.social_failures] == [0]
    assert told in transition.social_failures[0]["social"]
    assert not played.runner.actions.given[0, SOCIAL]
    transition = played.step(10)
    assert transition.social_failures == {}, "told once"
    assert len(asked) == 4, "not asked again"
    assert played.world.agents.state[0, SOCIAL] == AgentStatus.ACTIVE
    assert played.world.vehicles.speed[0, played.slot] > 0, "the fallback drives"
    played.reset(1)
    played.step(2)
    assert len(asked) == 5, "the next episode's agent is another, and fails at once"


def test_an_agent_that_raises_fails_in_the_frame_of_that_step(play):
    def act(seen):
        raise RuntimeError("no idea")

    played, frames = play(act, beside), []
    played.runner.listen(Listener(frames))
    played.reset()
    played.step()
    assert frames[-1].social_failures == {(0, 1): "raised RuntimeError: no idea"}
    played.step()
    assert frames[-1].social_failures == {}
    assert played.world.agents.release_step[0, SOCIAL] == -1, "its vehicle did not come from traffic"


class Listener:
    def __init__(self, frames):
        self._frames = frames

    def collect(self, frame, is_last):
        self._frames.append(frame)

    def reset(self, egos):
        pass


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


@pytest.mark.parametrize("kind", ["raises", "nan", "shape", "number", "text", "length"])
def test_what_a_batch_agent_answers_wrongly_fails_where_it_is_wrong(kind):
    class Fails(Batches):
        def act(self, batch):
            actions = np.zeros(len(batch.env_id))
            bad = batch.env_id == 1
            if kind == "raises" and bad.any():
                raise ValueError("simulation 1")
            actions[bad] = {"nan": np.nan, "number": 9}.get(kind, 0)
            if kind == "shape":
                return np.zeros((len(actions), 2))
            return {"text": "keep_lane", "length": actions[1:]}.get(kind, actions)

    def only(agents):
        return beside(agents)

    _, transitions, _ = run_batches(Fails, 3, change=only)
    failed = transitions[0].social_failures
    alone = kind in ("nan", "number")
    assert [*failed] == ([1] if alone else [0, 1, 2])
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
    assert transitions[0].social_failures == {row: {"social": "raised SystemExit: 3"} for row in range(3)}
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
    return Request(batch, [*env_ids], [f"car-{env_id}" for env_id in env_ids])


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


def test_an_agent_that_exits_fails(play):
    def act(seen):
        raise SystemExit(3)

    played = play(act, beside)
    played.reset()
    assert played.step().social_failures == {0: {"social": "raised SystemExit: 3"}}


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


@pytest.mark.parametrize(("second", "keep_alive"), [(1, False), (1, True), (0, True)])
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


def test_a_vehicle_that_came_from_traffic_goes_back_when_its_agent_fails(play):
    played = play(lambda seen: "fly", trap())
    played.reset()
    world = played.world
    for _ in range(120):
        if played.step().social_failures:
            break
    assert world.agents.release_step[0, SOCIAL] == world.step[0] - 1
    assert not played.runner.actions.given[0, SOCIAL]


def test_nobody_sits_in_an_agent_that_the_episode_does_not_fill(play):
    answers = Answers()
    played = play(answers)
    played.reset()
    played.step(5)
    assert played.world.agents.state[0, SOCIAL] == AgentStatus.VACANT
    assert answers.asked == []
    assert played.world.egos == 1


def test_the_episode_ends_with_the_egos_whatever_the_others_do(play):
    short = LANER.replace(max_episode_steps=5)
    played = play(Answers(), beside, social=short)
    played.reset()
    assert not played.step(8).finished[0]
    assert played.world.agents.state[0, SOCIAL] == AgentStatus.VACANT


def taking(played, slot, name="social"):
    """Announce an agent without a mission; return the transfer of a traffic vehicle to it."""
    generation = int(played.world.vehicles.generation[0, slot])
    pose = (*played.world.vehicles.position[0, slot].tolist(), float(played.world.vehicles.heading[0, slot]))
    start = AgentStart(
        name, pose, float(played.world.vehicles.speed[0, slot]), AgentMission(), interface=0, policy=0
    )
    number = played.parts.pool.announce(0, start)
    return Transfer(0, slot, generation, Owner.TRAFFIC, -1, Owner.AGENT, -1, Reason.TAKE, number)


def jumps(played, slot):
    """Return how far a vehicle is from where its speed would have taken it, and the change of speed."""
    now, before = played.world.vehicles, played.world.before
    moved = float(np.hypot(*(now.position[0, slot] - before.position[0, slot])))
    return abs(moved - float(before.speed[0, slot]) * 0.1), float(
        abs(now.speed[0, slot] - before.speed[0, slot])
    )


@pytest.mark.parametrize("model", ["bullet", "kinematic"])
def test_a_vehicle_goes_from_traffic_to_a_social_agent_and_back(play, model):
    played = play(
        keep,
        trap(),
        social=LANER.replace(vehicle_model=model, max_episode_steps=25),
    )
    played.reset()
    world, slot, generation, held = played.world, -1, -1, 0
    for _ in range(120):
        played.step()
        if slot < 0 and played.slot >= 0:
            slot = played.slot
            generation = int(world.vehicles.generation[0, slot])
            assert world.before.owner[0, slot] == Owner.TRAFFIC
        if slot >= 0:
            assert world.vehicles.generation[0, slot] == generation
            assert world.vehicles.alive[0, slot]
            apart, change = jumps(played, slot)
            assert apart < 0.1
            assert change < 0.95
            held += world.vehicles.owner[0, slot] == Owner.AGENT
            if world.before.owner[0, slot] == Owner.AGENT and world.vehicles.owner[0, slot] == Owner.TRAFFIC:
                break
    else:
        pytest.fail("the vehicle did not go back")
    assert held >= 1 + 25, "the step of the hand-over, those of the episode, and until the gate opens"
    for _ in range(20):
        played.step()
        if not world.vehicles.alive[0, slot] or world.vehicles.generation[0, slot] != generation:
            break
        assert jumps(played, slot)[0] < 0.1
        assert world.vehicles.owner[0, slot] == Owner.TRAFFIC


def test_a_spare_agent_takes_a_vehicle_that_a_transfer_gives_it(play):
    """As bubbles will do it: without a start, without a mission, by a transfer at the border of two steps."""
    played = play(keep)
    played.reset()
    world, ownership = played.world, played.parts.ownership
    driven = np.flatnonzero(world.vehicles.owner[0] == Owner.TRAFFIC)
    slot = int(driven[world.vehicles.speed[0, driven].argmax()])
    generation = int(world.vehicles.generation[0, slot])
    ownership.submit(transfers([taking(played, slot)]))
    for _ in range(10):
        played.step()
        assert world.vehicles.owner[0, slot] == Owner.AGENT
        assert played.slot == slot
        apart, change = jumps(played, slot)
        assert apart < 0.1
        assert change < 0.95
    release = Transfer(0, slot, generation, Owner.AGENT, SOCIAL, Owner.TRAFFIC, -1, Reason.RELEASE)
    ownership.submit(transfers([release]))
    for _ in range(10):
        played.step()
        assert world.vehicles.owner[0, slot] == Owner.TRAFFIC
        assert jumps(played, slot)[0] < 0.1
    assert world.agents.state[0, SOCIAL] == AgentStatus.VACANT


def test_an_agent_is_asked_in_the_step_in_which_it_enters_whoever_had_its_column(play):
    """Two agents in one column, the second in the step in which the first goes; the first decides seldom."""
    answers = Answers()
    played = play(answers)
    played.reset()
    world, ownership = played.world, played.parts.ownership
    first, second = np.flatnonzero(world.vehicles.owner[0] == Owner.TRAFFIC)[:2].tolist()
    ownership.submit(transfers([taking(played, first)]))
    played.step()
    world.agents.period[0, SOCIAL] = 50
    world.agents.next_due[0, SOCIAL] = 51
    played.step(5)
    generation = int(world.vehicles.generation[0, first])
    leave = Transfer(0, first, generation, Owner.AGENT, SOCIAL, Owner.NOBODY, -1, Reason.LEAVE)
    ownership.submit(transfers([taking(played, second), leave]))
    played.step()
    assert played.slot == second
    asked = [(int(request.batch.step[0]), bool(request.batch.is_first[0])) for _, request in answers.asked]
    assert asked == [(1, True), (7, True)]
    assert len({int(request.batch.hold[0]) for _, request in answers.asked}) == 2


def test_a_vehicle_taken_in_a_bend_is_where_sumo_had_it_and_stays_in_its_lane(play):
    """SUMO has both bumpers on the lane's middle: a chord, its middle inside the arc by length^2 / 8 R.

    An agent that keeps its lane takes it on from there, without a jump.
    """
    played = play(keep, scenario="roundabout")
    played.reset(episode=5)
    world, ownership = played.world, played.parts.ownership
    vehicles = world.vehicles
    slot = _turning(played)
    curvature = float(vehicles.yaw_rate[0, slot] / vehicles.speed[0, slot])
    aside = float(vehicles.length[0, slot]) ** 2 * curvature / 8
    assert abs(aside) > 0.1
    assert vehicles.lane_offset[0, slot] == pytest.approx(aside, abs=0.04)
    ownership.submit(transfers([taking(played, slot)]))
    for _ in range(10):
        played.step()
        assert vehicles.owner[0, slot] == Owner.AGENT
        assert jumps(played, slot)[0] < 0.1
        assert abs(vehicles.lane_offset[0, slot]) < abs(aside) + 0.1


def _turning(played):
    """Step until a vehicle of traffic has been on a bend of 12 to 25 m for some steps; return its slot."""
    vehicles, steady = played.world.vehicles, {}
    for _ in range(300):
        played.step()
        for slot in np.flatnonzero(vehicles.owner[0] == Owner.TRAFFIC).tolist():
            curvature = abs(float(vehicles.yaw_rate[0, slot])) / max(float(vehicles.speed[0, slot]), 1.0)
            key = slot, int(vehicles.lane[0, slot])
            steady[key] = steady.get(key, 0) + 1 if 1 / 25 < curvature < 1 / 12 else 0
            # SUMO keeps a vehicle on its way into a junction where others go first.
            chosen = np.array([0], np.int32), np.array([slot], np.int32)
            if steady[key] >= 8 and played.parts.ownership.can_take(*chosen)[0] == Refusal.NONE:
                return slot
    raise AssertionError("no vehicle turned")


def test_where_all_wait_time_goes_on_until_somebody_is_there(play):
    played = play(Answers(), trap(agent_id=EGO))
    played.reset()
    assert played.runner.alive[0, EGO]
    assert played.world.step[0] > 0
    assert played.world.vehicles.home[0, played.world.agents.slot[0, EGO]] == Owner.TRAFFIC


@pytest.mark.parametrize("period", [1, 5])
def test_social_agents_decide_while_all_egos_wait(play, period):
    answers = Answers()

    def waiting(agents):
        ego, social = beside(agents)
        return dataclasses.replace(ego, entry_time=3.0), social

    played = play(answers, waiting, period=period)
    played.reset()
    entered = int(played.world.step[0])
    assert entered >= 30
    assert [int(request.batch.step[0]) for _, request in answers.asked] == [*range(entered + 1)]


def test_what_a_condition_remembers_is_forgotten_when_the_same_episode_begins_again(play):
    remembered = []

    class Remembers:
        def evaluate(self, *, memory, time, **facts):
            remembered.append(len(memory))
            memory[self] = time
            return False

    def waiting(agents):
        rule = TakeOver(condition=Remembers())
        late = dataclasses.replace(
            agents[0], name="social", interface=0, policy=0, entry_time=1.0, take_over=rule
        )
        return (*agents, late)

    played = play(Answers(), waiting)
    for _ in range(2):
        played.reset(0)
        played.step(15)
    assert remembered.count(0) == 2
    assert remembered.count(1) == len(remembered) - 2 > 2


def test_where_nobody_ever_comes_the_error_says_so(play, monkeypatch):
    monkeypatch.setattr("smarts.env.runner.MAX_ENTRY_WAIT", 100)

    def never(agents):
        return (dataclasses.replace(agents[0], take_over=TakeOver(vehicle="no such", patience=np.inf)),)

    played = play(Answers(), never)
    with raises(ScenarioError, "episode 0, agents [0]", values=["simulation 0"]):
        played.reset()


def test_names_of_agents_are_their_own(play):
    played = play(Answers(), lambda agents: (*agents, dataclasses.replace(agents[0], interface=0, policy=0)))
    with raises(ScenarioError, values=["'agent-0', 'agent-0'"]):
        played.reset()


@pytest.mark.parametrize(
    "pool", [3, None, PooledAgents(LANER, 1), {"social": LANER}, [3], [PooledAgents(LANER, 1), LANER]]
)
def test_what_is_no_pool(pool):
    with pytest.raises(InterfaceError) as error:
        assemble([build_scenario("intersection")], [LANER], pool=pool)
    assert error.value.place == "pool"
