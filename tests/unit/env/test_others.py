"""Agents that are not the user's, through the runner: requests, late answers, handovers of vehicles."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from smarts.agents import ActionSpaceType, Agent, AgentInterface, AgentPolicy, DoneCriteria, PooledAgents
from smarts.agents.acting import InProcess
from smarts.agents.options import InterfaceError
from smarts.env.runner import EpisodeKey, SimulationRunner
from smarts.env.social_agents import SocialAgents
from smarts.errors import ActionError, ScenarioError
from smarts.sensors.observation import ObservationMaker
from smarts.sim.assembly import assemble
from smarts.sstudio.build import build_scenario
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import AgentStart, TakeOver
from smarts.types.mission import AgentMission
from smarts.types.transfers import Reason, Transfer, transfers
from smarts.types.vehicles import Owner
from tests.raising import raises

LANER = AgentInterface(action=ActionSpaceType.Lane, done_criteria=DoneCriteria())
EGO, SOCIAL = 0, 1


class Answers:
    """Agents elsewhere, whose answers arrive when the test says so."""

    def __init__(self):
        self.asked, self.ready, self.deadlines = [], {}, []

    def dispatch(self, observations):
        self.asked += observations

    def gather(self, deadline):
        self.deadlines.append(deadline)
        ready, self.ready = self.ready, {}
        return ready

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
        return dataclasses.replace(start, episode=episode, agents=self._change(start.agents))


class Played:
    """One ego and a social agent on the intersection."""

    def __init__(
        self, acting, change=lambda agents: agents, *, social=LANER, egos=1, period=1, scenario=None
    ):
        scenarios = [build_scenario(scenario or "intersection")]
        parts = assemble(scenarios, [LANER] * egos, pool=[PooledAgents(social, 1)])
        self.parts = dataclasses.replace(parts, schedule=Traffic(parts.schedule, change))
        others = SocialAgents(acting, ObservationMaker(parts.scene), deadline=0.25)
        self.runner = SimulationRunner(self.parts, [], period=period, others=others)
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
    social = dataclasses.replace(agents[0], name="social", interface=0, pose=second_start(), entry_time=0.0)
    return (*agents, social)


def trap(patience=50.0, agent_id=SOCIAL):
    """Let the ego, or a social agent, wait for a vehicle of traffic."""

    def change(agents):
        interface, rule = agent_id - SOCIAL, TakeOver(patience=patience)
        waiting = dataclasses.replace(agents[0], name="social", interface=interface, take_over=rule)
        return (*agents[:agent_id], waiting, *agents[agent_id + 1 :])

    return change


@cache
def second_start():
    """Return where the second ego of the scenario would begin, far from the first."""
    schedule = assemble([build_scenario("intersection")], [LANER] * 2)
    try:
        return schedule.schedule.start(0, 0).agents[1].pose
    finally:
        schedule.simulation.close()


def test_a_social_agent_drives_as_its_policy_says(play):
    seen, built = [], []

    def brake(observation):
        seen.append(observation)
        return "slow_down"

    def build(request):
        built.append((request.agent_id, request.name))
        return AgentPolicy.from_function(brake)

    played = play(InProcess(build), beside)
    played.reset()
    vehicle = played.slot
    assert played.world.vehicles.owner[0, vehicle] == Owner.AGENT
    start_speed = float(played.world.vehicles.speed[0, vehicle])
    played.step(30)
    assert built == [(SOCIAL, "social")]
    assert len(seen) == 30
    assert seen[0].ego_vehicle_state.position[:2] == pytest.approx(second_start()[:2], abs=1e-6)
    assert played.world.vehicles.speed[0, vehicle] < min(start_speed, 0.5) + 0.1
    played.reset(1)
    played.step(2)
    assert built == [(SOCIAL, "social")] * 2, "the next episode's agent is another"


def test_answers_that_are_late_or_of_the_past_are_dropped(play):
    answers = Answers()
    played = play(answers, beside)
    played.reset()
    (first,) = answers.asked
    played.step()
    assert played.runner.late == 1
    answers.ready = {first: "change_lane_left"}
    played.step()
    assert not played.runner.actions.given[0, SOCIAL]
    answers.ready = {answers.asked[-1]: "slow_down"}
    played.step()
    assert played.runner.actions.given[0, SOCIAL]
    assert played.runner.actions.values[0, SOCIAL, 0] == 1
    assert set(answers.deadlines) == {0.25}
    last = answers.asked[-1]
    played.reset(1)
    answers.ready = {last: "keep_lane"}
    played.step()
    assert not played.runner.actions.given[0, SOCIAL], "an answer of the last episode"


def test_a_bad_answer_names_the_agent(play):
    played = play(InProcess(lambda agent_id: Agent.from_function(lambda seen: "fly")), beside)
    played.reset()
    with raises(ActionError, values=["social", "fly"]):
        played.step()


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
    start = AgentStart(name, pose, float(played.world.vehicles.speed[0, slot]), AgentMission(), interface=0)
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
        InProcess(lambda agent_id: Agent.from_function(lambda seen: "keep_lane")),
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
    assert held == 1 + 25, "the step of the hand-over, and those of the episode"
    for _ in range(20):
        played.step()
        if not world.vehicles.alive[0, slot] or world.vehicles.generation[0, slot] != generation:
            break
        assert jumps(played, slot)[0] < 0.1
        assert world.vehicles.owner[0, slot] == Owner.TRAFFIC


def test_a_spare_agent_takes_a_vehicle_that_a_transfer_gives_it(play):
    """As bubbles will do it: without a start, without a mission, by a transfer at the border of two steps."""
    played = play(InProcess(lambda agent_id: Agent.from_function(lambda seen: "keep_lane")))
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
    answers, built = Answers(), []
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
    release = Transfer(0, first, generation, Owner.AGENT, SOCIAL, Owner.TRAFFIC, -1, Reason.RELEASE)
    ownership.submit(transfers([taking(played, second), release]))
    played.step()
    assert played.slot == second
    asked = [(request.name, request.step) for request in answers.asked]
    assert asked == [("social", 1), ("social~2", 7)]
    assert len({request.hold for request in answers.asked}) == 2
    host = InProcess(lambda request: built.append(request.name) or AgentPolicy.from_function(str))
    host.dispatch(dict.fromkeys(answers.asked, "seen"))
    assert [*host.gather(0.0).values()] == ["seen", "seen"]
    assert built == ["social", "social~2"], "each agent has a policy of its own"


def test_a_vehicle_taken_in_a_bend_is_where_sumo_had_it_and_stays_in_its_lane(play):
    """SUMO has both bumpers on the lane's middle: a chord, its middle inside the arc by length^2 / 8 R.

    An agent that keeps its lane takes it on from there, without a jump.
    """
    keep = InProcess(lambda agent_id: Agent.from_function(lambda seen: "keep_lane"))
    played = play(keep, scenario="roundabout")
    played.reset()
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
            if steady[key] == 8:
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
    assert [request.step for request in answers.asked] == [*range(entered + 1)]


def test_what_a_condition_remembers_is_forgotten_when_the_same_episode_begins_again(play):
    remembered = []

    class Remembers:
        def evaluate(self, *, memory, time, **facts):
            remembered.append(len(memory))
            memory[self] = time
            return False

    def waiting(agents):
        rule = TakeOver(condition=Remembers())
        late = dataclasses.replace(agents[0], name="social", interface=0, entry_time=1.0, take_over=rule)
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
    played = play(Answers(), lambda agents: (*agents, dataclasses.replace(agents[0], interface=0)))
    with raises(ScenarioError, values=["'agent-0', 'agent-0'"]):
        played.reset()


@pytest.mark.parametrize(
    "pool", [3, None, PooledAgents(LANER, 1), {"social": LANER}, [3], [PooledAgents(LANER, 1), LANER]]
)
def test_what_is_no_pool(pool):
    with pytest.raises(InterfaceError) as error:
        assemble([build_scenario("intersection")], [LANER], pool=pool)
    assert error.value.place == "pool"
