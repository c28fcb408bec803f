"""The social agents of an episode: their roles, as scenario and environment give them, and their starts."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from smarts.agents.options import InterfaceError
from smarts.agents.social import ALL_MISSIONS, Cast, SocialPolicy, Wanted, interface_of, wanted
from smarts.errors import ScenarioError
from smarts.sim.starts import TRIES, Shape, agent_start, is_ahead, overlap, place_agents, shape_of
from smarts.sstudio import sstypes as t
from smarts.sstudio.episodes import EpisodePlan
from smarts.types.episode import AgentStart

if TYPE_CHECKING:
    from numpy.random import Generator

    from smarts.sstudio.built import BuiltScenario

WHEN_FREE = 1e-3
"""Entry time of an agent whose start is occupied when the episode begins [s]: it enters when it is free."""


class Role(NamedTuple):
    """A social agent of an episode that has a mission."""

    name: str
    mission: t.AnyMission
    policy: int
    """Number of its policy."""
    speed: float | None = None
    """Speed at the start [m/s]; None: the mission's."""
    varies: bool = False
    """Whether its start varies as the egos' do."""


def wanted_by(actor: t.SocialAgentActor) -> Wanted:
    """Return the policy that an actor asks for."""
    boid = actor.id if isinstance(actor, t.BoidAgentActor) else ""
    return wanted(actor.agent_locator, actor.policy_kwargs, boid)


def roles_of(plan: EpisodePlan, cast: Cast, place: str) -> tuple[Role, ...]:
    """Return the social agents of an episode: the scenario's, then those that the environment adds.

    Raises:
        InterfaceError: The environment adds more agents than there are missions left.
    """
    if not cast.policies:
        return ()
    described = [
        Role(each.name, each.mission, cast.numbers[wanted_by(each.actor)], each.actor.initial_speed)
        for each in plan.social
    ]
    dealt = zip(_dealt(plan, cast, place), _missions(plan), strict=False)
    added = [
        Role(f"social-agent-{number}", mission, policy, varies=True)
        for number, (policy, mission) in enumerate(dealt)
    ]
    return (*described, *added)


def _missions(plan: EpisodePlan) -> Iterator[t.AnyMission]:
    """Yield the missions for agents that the environment adds: the egos' rest, or without any random ones."""
    if not _are_random(plan):
        return iter(plan.spare)
    return (t.Mission(t.RandomRoute(f"social-{number}")) for number in itertools.count())


def _are_random(plan: EpisodePlan) -> bool:
    are_so = (isinstance(each, t.Mission) and isinstance(each.route, t.RandomRoute) for each in plan.missions)
    return plan.drawn is None and not plan.spare and all(are_so)


def _dealt(plan: EpisodePlan, cast: Cast, place: str) -> list[int]:
    """Return the number of the policy of each agent that the environment adds."""
    dealt = [policy for policy, count in cast.extra if isinstance(count, int) for _ in range(count)]
    rest = [policy for policy, count in cast.extra if count == ALL_MISSIONS]
    left = len(plan.spare)
    needs = len(dealt) + len(rest)
    if needs > left and not (_are_random(plan) and not rest):
        raise InterfaceError(
            f"{needs} social agents or more, and {left} missions that the learning agents leave",
            place=f"social_agents in {place}",
            remedy=f"give at most {left} in all, or fewer learning agents",
        )
    return [*dealt, *itertools.islice(itertools.cycle(rest), left - len(dealt) if rest else 0)]


def room_of(
    plans: Sequence[Sequence[Role]], bubbles: Sequence[tuple[int, int]], cast: Cast
) -> tuple[int, ...]:
    """Return how many agents of each interface an episode of a scenario has at most, by its number.

    Args:
        plans: The roles of each of the scenario's episodes.
        bubbles: Policy and most vehicles of each of its bubbles.
        cast: The policies.
    """
    room = [0] * len(cast.interfaces)
    for number in range(len(room)):
        of_interface = [policy.interface == number for policy in cast.policies]
        missions = max((sum(of_interface[role.policy] for role in roles) for roles in plans), default=0)
        room[number] = missions + sum(count for policy, count in bubbles if of_interface[policy])
    return tuple(room)


def draw_social_starts(
    built: BuiltScenario,
    roles: Sequence[Role],
    egos: Sequence[AgentStart],
    policies: Sequence[SocialPolicy],
    generator: Generator,
) -> tuple[AgentStart, ...]:
    """Draw the social agents' starts of one episode, apart from each other and from the egos' if they can be.

    An agent whose start is occupied when the episode begins enters when it is free.

    Args:
        built: The scenario.
        roles: The agents.
        egos: Their starts.
        policies: Policies of the run.
        generator: Draws random routes and the variation of starts.

    Raises:
        ScenarioError: A mission cannot be on the map.
    """
    starts: list[AgentStart] = []
    for role in roles:
        policy = policies[role.policy]
        drawn = draw_start(built, role, shape_of(interface_of(policy.spec)), [*egos, *starts], generator)
        speed = drawn.speed if role.speed is None else role.speed
        starts.append(
            replace(
                drawn,
                speed=float(speed),
                interface=policy.interface,
                policy=role.policy,
                period=policy.period,
            )
        )
    return tuple(starts)


def draw_start(
    built: BuiltScenario, role: Role, shape: Shape, others: Sequence[AgentStart], generator: Generator
) -> AgentStart:
    """Draw the start of one social agent, apart from others if it can be; see `draw_social_starts`."""
    roads, place = built.roads(), f"{built.name}: {role.name}"
    variation = built.scenario.start_variation if role.varies else None
    start = None
    for _ in range(TRIES):
        (placed,) = place_agents(built, [role.mission], [shape], generator, variation, place)
        drawn = agent_start(placed, roads, role.name, shape, generator)
        if is_ahead(drawn):
            if not any(overlap(drawn, other) for other in others):
                return drawn
            start = replace(drawn, entry_time=WHEN_FREE)
    if start is None:
        raise ScenarioError(
            "the goal is not ahead of the start", place=place, remedy="move the mission's start or its goal"
        )
    return start
