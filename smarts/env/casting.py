"""Casting: finds the social policies that scenarios and an environment ask for, before the first step."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from smarts.agents.acting import FAILURES, built_agent
from smarts.agents.hosting.facts import check_period
from smarts.agents.hosting.links import is_address
from smarts.agents.hosting.options import (
    IN_PROCESS,
    OTHERS,
    HostError,
    HostOptions,
    HostsByLocator,
    Starter,
    host_of,
)
from smarts.agents.hosting.remote import RemoteAgent
from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.policy import Agent, BatchAgent
from smarts.agents.social import (
    NO_CAST,
    BubbleLearning,
    Cast,
    SocialAgents,
    SocialPolicy,
    Wanted,
    distinct,
    interface_of,
    wanted,
)
from smarts.agents.spec import AgentSpec
from smarts.bubbles.placing import agent_actor
from smarts.errors import OwnCodeError, SmartsError, nearest_names
from smarts.observations.lists import feature_list
from smarts.sim.social_starts import wanted_by
from smarts.sstudio import sstypes as t
from smarts.sstudio.built import BuiltScenario
from smarts.types.actions import ActionSpaceType
from smarts.zoo import find_entry, make_spec, search
from smarts.zoo.serving import starter

HOSTS_HERE: HostsByLocator = {}
"""All agents act in this process."""


class Part(NamedTuple):
    """What asks for a policy."""

    name: str
    """Name of the policy, for errors and records."""
    locator: str
    options: Mapping[str, Any]
    place: str
    """Place that errors name."""
    boid: str = ""
    keep_alive: bool = False


@dataclass
class Casting:
    """Makes each distinct policy once."""

    policies: list[SocialPolicy] = field(default_factory=list)
    numbers: dict[Wanted, int] = field(default_factory=dict)
    hosts: HostsByLocator = field(default_factory=dict)
    """Options of where agents act, by locator."""

    def add(self, part: Part) -> int:
        """Return the number of a policy, which is made if it is not there yet.

        Raises:
            SmartsError: There is no such agent, or it cannot be made; names what asks for it.
        """
        key = wanted(part.locator, part.options, part.boid)
        if key not in self.numbers:
            self.numbers[key] = len(self.policies)
            self.policies.append(_policy(part, self.hosts))
        number = self.numbers[key]
        if part.keep_alive:
            self.policies[number] = replace(self.policies[number], keep_alive=True)
        return number

    def cast(self, extra: Iterable[tuple[int, int | str]]) -> Cast:
        """Return the policies, their interfaces numbered in order of appearance."""
        # The specs of all policies have an interface, see `_interface`.
        interfaces = [_interface(policy.spec, policy.name) for policy in self.policies]
        known = distinct(interfaces)
        numbered = [
            replace(policy, interface=known.index(interface))
            for policy, interface in zip(self.policies, interfaces, strict=True)
        ]
        return Cast(tuple(numbered), self.numbers, tuple(extra))


def cast_of(
    scenarios: Sequence[BuiltScenario],
    added: Sequence[SocialAgents] = (),
    learning: BubbleLearning | None = None,
    hosts: HostsByLocator = HOSTS_HERE,
) -> Cast:
    """Return the social policies of a run.

    Args:
        scenarios: Their bubbles and social agents' missions ask for policies.
        added: What the environment asks for.
        learning: Bubbles in which the learning agents drive.
        hosts: Where agents act, by locator.

    Raises:
        SmartsError: A locator or its arguments are unknown; an agent cannot be made, does not act, or not
            where it is to; or a scenario has no bubble to learn in.
    """
    casting = Casting(hosts=hosts)
    if learning:
        _check_learning(scenarios, learning)
    for built in scenarios:
        search(built.source)
        for part in _parts(built, learning):
            casting.add(part)
    extra = [
        (casting.add(Part(each.agent, each.agent, each.options, "social_agents")), each.count)
        for each in added
    ]
    _check_hosts(hosts, casting.policies)
    cast = casting.cast(extra) if casting.policies else NO_CAST
    return replace(cast, learning=learning)


def _check_hosts(hosts: HostsByLocator, policies: Sequence[SocialPolicy]) -> None:
    """Raise if a place is given for an agent that is not in the run."""
    known = [policy.locator for policy in policies]
    for locator in hosts:
        if locator not in (OTHERS, *known):
            raise InterfaceError(
                f"no agent of the run is {locator!r}", place="hosts", remedy=nearest_names(locator, known)
            )


def check_agent(locator: str, options: Mapping[str, Any], hosts: HostsByLocator = HOSTS_HERE) -> None:
    """Raise unless an agent of the zoo can be made and drive.

    Raises:
        SmartsError: It cannot; names the locator.
    """
    _policy(Part(locator, locator, options, ""), hosts)


def _check_learning(scenarios: Sequence[BuiltScenario], learning: BubbleLearning) -> None:
    """Raise unless every scenario has a bubble in which the learning agents drive, and every id is known."""
    found = {
        built.name: [bubble.id for bubble in built.scenario.bubbles or () if agent_actor(bubble)]
        for built in scenarios
    }
    known = {bubble for ids in found.values() for bubble in ids}
    for bubble in {*learning.bubbles} - known:
        remedy = nearest_names(bubble, known) if known else "use scenarios with bubbles"
        raise InterfaceError(f"there is no bubble {bubble!r}", place="learn_in_bubbles", remedy=remedy)
    for name, ids in found.items():
        if not any(map(learning.has, ids)):
            raise InterfaceError(
                f"the scenario {name!r} has no bubble in which agents learn",
                place="learn_in_bubbles",
                remedy="use scenarios with bubbles, or name bubbles of each",
            )


def locators_of(scenario: t.Scenario) -> list[str]:
    """Return the locators of the agents that a scenario's bubbles and missions ask for."""
    return [part.locator for part in _parts_of(scenario, "", None)]


def check_locators(built: BuiltScenario) -> list[str]:
    """Return notes on the agents of a scenario whose own code cannot be imported here; none is made.

    Raises:
        UnknownNameError: There is no such agent; names the bubble or mission that asks for it.
    """
    search(built.source)
    notes = []
    for part in _parts(built, None):
        try:
            if not is_address(part.locator):
                find_entry(part.locator)
        except OwnCodeError as error:
            notes.append(f"{part.place}: {error.problem}: runs need it by --import, or on the PYTHONPATH")
        except SmartsError as error:
            raise _at(part.place, error) from error
    return notes


def _at(place: str, error: SmartsError) -> SmartsError:
    """Return an error with the place of what asks for the policy, too."""
    where = ", ".join(filter(None, (place, error.place)))
    return type(error)(error.problem, place=where, remedy=error.remedy)


def _parts(built: BuiltScenario, learning: BubbleLearning | None) -> Iterator[Part]:
    return _parts_of(built.scenario, built.name, learning)


def _parts_of(scenario: t.Scenario, name: str, learning: BubbleLearning | None) -> Iterator[Part]:
    for bubble in scenario.bubbles or ():
        actor = agent_actor(bubble)
        if actor is not None and not (learning and learning.has(bubble.id)):
            place = f"{name}: bubble {bubble.id!r}"
            yield _part(actor, place, keep_alive=bubble.keep_alive)
    for group, (actors, _) in (scenario.social_agent_missions or {}).items():
        for actor in [actors] if isinstance(actors, t.SocialAgentActor) else actors:
            yield _part(actor, f"{name}: social_agent_missions[{group!r}]")


def _part(actor: t.SocialAgentActor, place: str, *, keep_alive: bool = False) -> Part:
    locator, _, boid = wanted_by(actor)
    return Part(actor.name, locator, actor.policy_kwargs, f"{place}, actor {actor.name!r}", boid, keep_alive)


def _policy(part: Part, hosts: HostsByLocator = HOSTS_HERE) -> SocialPolicy:
    """Make a policy once, to see what it observes; whoever runs it makes its own."""
    host = host_of(hosts, part.locator)
    try:
        return _made(part, host, hosts)
    except SmartsError as error:
        raise _at(part.place, error) from error
    except FAILURES as error:
        raise InterfaceError(
            f"{part.locator!r} cannot be made: {type(error).__name__}: {error}",
            place=part.place,
            remedy="see the agent's options: smarts-bench zoo describe",
        ) from error


def _made(part: Part, host: HostOptions, hosts: HostsByLocator) -> SocialPolicy:
    """Return a policy that acts in this process, or where its host says."""
    spec = make_spec(part.locator, **part.options)
    interface = _interface(spec, part.locator)
    agent: Any = built_agent(spec, part.locator)
    is_batch, place = isinstance(agent, BatchAgent), f"agent {part.locator!r}"
    if is_batch:
        check_features(agent.observation, place)
    return SocialPolicy(
        name=part.name,
        locator=part.locator,
        spec=spec.replace(interface=interface),
        interface=0,
        period=check_period(getattr(agent, "period", 1), place),
        step_length=getattr(agent, "step_length", None),
        is_boid=bool(part.boid),
        keep_alive=part.keep_alive,
        observation=agent.observation if is_batch else None,
        start=_start(part, agent, host, is_named=part.locator in hosts),
        host=host,
    )


def check_features(observation: Any, place: str) -> None:
    """Raise unless an agent observes features that exist.

    Raises:
        SmartsError: One does not, or is given wrong options; names the agent.
    """
    try:
        feature_list(observation)
    except SmartsError as error:
        raise _at(place, error) from error


def _start(part: Part, agent: Agent, host: HostOptions, *, is_named: bool) -> Starter | None:
    """Return what starts an agent elsewhere, None if it acts in this process.

    Raises:
        HostError: The agent cannot act where it is to.
    """
    place = f"agent {part.locator!r}"
    if isinstance(agent, RemoteAgent):
        if host.where != IN_PROCESS and is_named:
            raise HostError(
                f"where is {host.where!r}, and the agent has its own place",
                place=place,
                remedy="leave `where` out of its entry in hosts",
            )
        return agent.start
    if host.where == IN_PROCESS:
        if is_named and host.deadline_ms is not None:
            raise HostError(
                "deadline_ms is given, and the agent acts in process, where it is never late",
                place=place,
                remedy="give where: process, or delay_steps",
            )
        return None
    if not isinstance(agent, BatchAgent):
        if not is_named:
            return None  # "*" leaves out agents that cannot
        raise HostError(
            f"where is {host.where!r}, and the agent acts on Observation objects",
            place=place,
            remedy="derive it from BatchAgent, which acts on arrays, or let it act in process",
        )
    return starter(part.locator, part.options, host)


def _interface(spec: AgentSpec, place: str) -> AgentInterface:
    interface = interface_of(spec)
    if interface.action in (None, ActionSpaceType.Empty):
        raise InterfaceError(
            f"the interface's action is {interface.action!r}: the agent cannot drive",
            place=place,
            remedy="give AgentInterface(action=...) an action type such as ActionSpaceType.Lane",
        )
    return interface
