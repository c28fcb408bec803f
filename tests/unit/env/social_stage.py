"""Simulations whose social agents act by functions of a test's."""

import dataclasses
from contextlib import closing
from functools import cache

from smarts.agents import (
    ActionSpaceType,
    AgentInterface,
    AgentPolicy,
    AgentSpec,
    DoneCriteria,
)
from smarts.agents.social import Cast, SocialPolicy
from smarts.env.runner import EpisodeKey, SimulationRunner
from smarts.sim.assembly import assemble
from smarts.sstudio.build import build_scenario
from smarts.types.episode import TakeOver

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
        self.runner = SimulationRunner(self.parts, [], **options)
        if host is not None:
            self.runner._requests._host = host
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
    with closing(schedule.simulation):
        return schedule.schedule.start(0, 0).agents[ego].pose
