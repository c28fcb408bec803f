"""Casting: finds the social policies that scenarios and an environment ask for, before the first step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from smarts.agents.acting import FAILURES, built_agent
from smarts.agents.hosting.facts import check_period
from smarts.agents.hosting.links import is_address
from smarts.agents.hosting.options import (
    IN_PROCESS,
    OTHERS,
    HostError,
    HostsByLocator,
    Starter,
    host_of,
)
from smarts.agents.hosting.remote import RemoteAgent
from smarts.agents.options import InterfaceError
from smarts.agents.policy import Agent, BatchAgent
from smarts.agents.social import (
    BubbleLearning,
    Cast,
    SocialAgents,
    SocialPolicy,
    Wanted,
    distinct,
    interface_of,
    wanted,
)
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
    wanted: Wanted
    options: Mapping[str, Any]
    place: str
    """Place that errors name."""
    keep_alive: bool = False


def cast_of(
    scenarios: Sequence[BuiltScenario],
    added: Sequence[SocialAgents] = (),
    learning: BubbleLearning | None = None,
    hosts: HostsByLocator = HOSTS_HERE,
) -> Cast:
    """Return the social policies of a run; equal ones that several parts ask for are made once.

    Args:
        scenarios: Their bubbles and social agents' missions ask for policies.
        added: What the environment asks for.
        learning: Bubbles in which the learning agents drive.
        hosts: Where agents act, by locator.

    Raises:
        SmartsError: A locator or its arguments are unknown; an agent cannot be made, does not act, or not
            where it is to; or a scenario has no bubble to learn in.
    """
    if learning:
        _check_learning(scenarios, learning)
    asked: list[Part] = []
    for built in scenarios:
        search(built.source)
        asked += _parts(built.scenario, built.name, learning)
    extra = [_added(each.agent, each.options, "social_agents") for each in added]
    first: dict[Wanted, Part] = {}
    for part in (*asked, *extra):
        first.setdefault(part.wanted, part)
    kept = {part.wanted for part in asked if part.keep_alive}
    policies = [replace(_policy(part, hosts), keep_alive=key in kept) for key, part in first.items()]
    _check_hosts(hosts, policies)
    interfaces = distinct(interface_of(policy.spec) for policy in policies)
    numbers = {key: number for number, key in enumerate(first)}
    return Cast(
        tuple(replace(policy, interface=interfaces.index(interface_of(policy.spec))) for policy in policies),
        numbers,
        tuple((numbers[part.wanted], each.count) for part, each in zip(extra, added, strict=True)),
        learning,
    )


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
    _policy(_added(locator, options, ""), hosts)


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


def check_locators(built: BuiltScenario) -> list[str]:
    """Return notes on the agents of a scenario whose own code cannot be imported here; none is made.

    Raises:
        UnknownNameError: There is no such agent; names the bubble or mission that asks for it.
    """
    search(built.source)
    notes = []
    for part in _parts(built.scenario, built.name):
        try:
            if not is_address(part.wanted.locator):
                find_entry(part.wanted.locator)
        except OwnCodeError as error:
            notes.append(f"{part.place}: {error.problem}: runs need it by --import, or on the PYTHONPATH")
        except SmartsError as error:
            raise _at(part.place, error) from error
    return notes


def _at(place: str, error: SmartsError) -> SmartsError:
    """Return an error with the place of what asks for the policy, too."""
    where = ", ".join(filter(None, (place, error.place)))
    return type(error)(error.problem, place=where, remedy=error.remedy)


def _added(locator: str, options: Mapping[str, Any], place: str) -> Part:
    """Return what asks for a policy that no scenario names."""
    return Part(locator, wanted(locator, options), options, place)


def _parts(scenario: t.Scenario, name: str = "", learning: BubbleLearning | None = None) -> Iterator[Part]:
    """Yield what asks for policies in a scenario."""
    for bubble in scenario.bubbles or ():
        actor = agent_actor(bubble)
        if actor is not None and not (learning and learning.has(bubble.id)):
            place = f"{name}: bubble {bubble.id!r}"
            yield _part(actor, place, keep_alive=bubble.keep_alive)
    for group, (actors, _) in (scenario.social_agent_missions or {}).items():
        for actor in [actors] if isinstance(actors, t.SocialAgentActor) else actors:
            yield _part(actor, f"{name}: social_agent_missions[{group!r}]")


def _part(actor: t.SocialAgentActor, place: str, *, keep_alive: bool = False) -> Part:
    place = f"{place}, actor {actor.name!r}"
    return Part(actor.name, wanted_by(actor), actor.policy_kwargs, place, keep_alive)


def _policy(part: Part, hosts: HostsByLocator) -> SocialPolicy:
    """Make a policy once, to see what it observes; whoever runs it makes its own."""
    try:
        return _made(part, hosts)
    except SmartsError as error:
        raise _at(part.place, error) from error
    except FAILURES as error:
        raise InterfaceError(
            f"{part.wanted.locator!r} cannot be made: {type(error).__name__}: {error}",
            place=part.place,
            remedy="see the agent's options: smarts-bench zoo describe",
        ) from error


def _made(part: Part, hosts: HostsByLocator) -> SocialPolicy:
    """Return a policy that acts in this process, or where its host says."""
    locator, place = part.wanted.locator, f"agent {part.wanted.locator!r}"
    spec = make_spec(locator, **part.options)
    interface = interface_of(spec)
    if interface.action in (None, ActionSpaceType.Empty):
        raise InterfaceError(
            f"the interface's action is {interface.action!r}: the agent cannot drive",
            place=locator,
            remedy="give AgentInterface(action=...) an action type such as ActionSpaceType.Lane",
        )
    agent: Any = built_agent(spec, locator)
    is_batch = isinstance(agent, BatchAgent)
    if is_batch:
        feature_list(agent.observation)
    return SocialPolicy(
        name=part.name,
        locator=locator,
        spec=spec,
        interface=0,
        period=check_period(getattr(agent, "period", 1), place),
        step_length=getattr(agent, "step_length", None),
        is_boid=bool(part.wanted.boid),
        observation=agent.observation if is_batch else None,
        start=_start(part, agent, hosts),
        host=host_of(hosts, locator),
    )


def _start(part: Part, agent: Agent, hosts: HostsByLocator) -> Starter | None:
    """Return what starts an agent elsewhere, None if it acts in this process.

    Raises:
        HostError: The agent is named in `hosts`, and cannot act as it says; "*" leaves out such agents.
    """
    if isinstance(agent, RemoteAgent):
        return agent.start
    locator, problem, remedy = part.wanted.locator, "", ""
    host = host_of(hosts, locator)
    if host.where == IN_PROCESS:
        if host.deadline_ms is not None:
            problem = "deadline_ms is given, and the agent acts in process, where it is never late"
            remedy = "give where: process, or delay_steps"
    elif isinstance(agent, BatchAgent):
        return starter(locator, part.options, host)
    else:
        problem = f"where is {host.where!r}, and the agent acts on Observation objects"
        remedy = "derive it from BatchAgent, which acts on arrays, or let it act in process"
    if problem and locator in hosts:
        raise HostError(problem, place=f"agent {locator!r}", remedy=remedy)
    return None
