"""Episodes of a scenario: a traffic variation, and missions for the egos."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from smarts.errors import ScenarioError
from smarts.registry import is_own_name
from smarts.sstudio import sstypes as t

if TYPE_CHECKING:
    from numpy.random import Generator

EgoMissions = Sequence[t.AnyMission | t.DrawnMission]
"""A scenario's `ego_missions`."""


@dataclass(frozen=True)
class SocialRole:
    """A social agent of an episode, as the scenario describes it."""

    name: str
    """Name of the agent, such as "social-agent-buses-driver"."""
    actor: t.SocialAgentActor
    mission: t.AnyMission


@dataclass(frozen=True)
class EpisodePlan:
    """Traffic and missions of one episode."""

    traffic: str | None
    """The variation of the traffic; None where the scenario has none."""
    missions: tuple[t.AnyMission, ...]
    """One mission for each ego; where they are drawn, none until `dealt` draws a set."""
    spare: tuple[t.AnyMission, ...] = ()
    """The missions that the egos leave, beginning behind theirs; none where egos have random routes. Where
    missions are drawn, those of the first set until `dealt` draws one."""
    social: tuple[SocialRole, ...] = ()
    drawn: t.DrawnMission | None = None
    """What the egos' missions are drawn from."""

    def dealt(self, egos: int, generator: Generator) -> EpisodePlan:
        """Return the plan with the missions of one set, if they are drawn; the egos' are in a random order.

        Args:
            egos: How many egos there are.
            generator: Draws a set and the order.
        """
        if self.drawn is None:
            return self
        chosen = missions_of_set(self.drawn, int(generator.integers(len(self.drawn.sets))))
        missions = tuple(chosen[place] for place in generator.permutation(egos).tolist())
        return replace(self, missions=missions, spare=tuple(chosen[egos:]))


def drawn_mission(described: EgoMissions) -> t.DrawnMission | None:
    """Return what the egos' missions are drawn from, None if they are not drawn."""
    return next((each for each in described if isinstance(each, t.DrawnMission)), None)


def missions_of_set(drawn: t.DrawnMission, number: int) -> list[t.Mission]:
    """Return the missions of one of the sets that were drawn at build."""
    pairs = drawn.sets[number]
    return [t.Mission(t.Route(drawn.starts[start], drawn.goals[goal])) for start, goal in pairs]


def check_without_handovers(scenario: t.Scenario, place: str) -> None:
    """Raise if agents may take over vehicles of traffic: hand-overs need exact traffic.

    Args:
        scenario: The scenario.
        place: The scenario's name, for the error.

    Raises:
        ScenarioError: There are bubbles, social agents, or missions that begin in a vehicle of traffic.
    """
    missions = scenario.ego_missions or ()
    tactics = [each.entry_tactic for each in missions if not isinstance(each, t.DrawnMission)]
    takes_over = any(isinstance(tactic, t.TrapEntryTactic | t.IdEntryTactic) for tactic in tactics)
    if scenario.bubbles or scenario.social_agent_missions or takes_over:
        raise ScenarioError(
            "traffic_step is set, and agents of the scenario may take over vehicles of traffic",
            place=place,
            remedy="leave out traffic_step: hand-overs need exact traffic",
        )


def check_engine(engine: str, traffic: str | None, is_recorded: bool, place: str) -> None:
    """Raise if an engine is to drive a recording that drives routes, or the other way round.

    Args:
        engine: Name of the engine.
        traffic: Name of the traffic, None for none.
        is_recorded: Whether the traffic is a recording.
        place: The scenario's name, for the error.

    Raises:
        ScenarioError: It is.
    """
    if is_recorded != (engine == "Recorded") and not is_own_name(engine):
        problem = f"the engine {engine!r} cannot drive the traffic {traffic!r}, which is "
        problem += "recorded" if is_recorded else "not recorded"
        remedy = "leave out the traffic engine of the options: each scenario names its own"
        raise ScenarioError(problem, place=place, remedy=remedy)


def episode_plans(
    scenario: t.Scenario, egos: int, *, traffic: Sequence[str] | None = None, place: str = ""
) -> tuple[EpisodePlan, ...]:
    """Return every variation of the traffic with every set of missions; episodes cycle through them.

    Where groups of social agents take turns, each of these comes with every turn. With as many missions as
    egos there is one set. With fewer egos, sets of that many follow each other through the missions, round to
    the first if need be, until each mission has been in one. Without missions, every ego gets a random route.
    Missions that are drawn are one set, which `EpisodePlan.dealt` draws.

    Args:
        scenario: The scenario.
        egos: How many learning agents there are.
        traffic: The variations of the traffic that are played, by default all of the scenario.
        place: The scenario's name, for the error.

    Raises:
        ScenarioError: There are more egos than missions.
    """
    missions, drawn = expand(scenario.ego_missions or ()), drawn_mission(scenario.ego_missions or ())
    sets = mission_sets(scenario.ego_missions or (), egos, place)
    left = max(0, len(missions) - egos)
    spares = [
        tuple(missions[((first + 1) * egos + rank) % len(missions)] for rank in range(left))
        for first in range(len(sets))
    ]
    return tuple(
        EpisodePlan(name, chosen, spare, social, drawn)
        for name in traffic or scenario.traffic or (None,)
        for chosen, spare in zip(sets, spares, strict=True)
        for social in social_turns(scenario)
    )


def mission_sets(described: EgoMissions, egos: int, place: str = "") -> tuple[tuple[t.AnyMission, ...], ...]:
    """Return the sets of missions that `egos` agents take turns with; see `episode_plans`."""
    if not described:
        return (tuple(t.Mission(t.RandomRoute(f"ego-{ego}")) for ego in range(egos)),)
    check_egos(described, egos, place)
    missions = expand(described)
    if egos == 0 or drawn_mission(described):
        return ((),)
    count = math.ceil(len(missions) / egos)
    return tuple(
        tuple(missions[(first * egos + ego) % len(missions)] for ego in range(egos)) for first in range(count)
    )


def social_turns(scenario: t.Scenario) -> tuple[tuple[SocialRole, ...], ...]:
    """Return the social agents of each turn; see `Scenario.social_agent_missions`."""
    groups = [_group_turns(name, *pair) for name, pair in (scenario.social_agent_missions or {}).items()]
    turns = max((len(choices) for choices in groups), default=1)
    return tuple(
        tuple(role for choices in groups for role in choices[turn % len(choices)]) for turn in range(turns)
    )


def _group_turns(
    group: str, actors: Sequence[t.SocialAgentActor], described: Sequence[t.AnyMission]
) -> list[tuple[SocialRole, ...]]:
    """Return the agents of one group in each of its turns."""
    actors = [actors] if isinstance(actors, t.SocialAgentActor) else actors
    missions = expand(described)

    def role(actor: t.SocialAgentActor, mission: t.AnyMission | None = None) -> SocialRole:
        name = t.Bubble.to_actor_id(actor, group)
        return SocialRole(name, actor, t.Mission(t.RandomRoute(name)) if mission is None else mission)

    if not missions:
        return [(role(actor),) for actor in actors]
    if len(actors) == len(missions):
        return [tuple(map(role, actors, missions))]
    return [(role(actor, mission),) for actor in actors for mission in missions]


def check_egos(described: EgoMissions, egos: int, place: str = "") -> None:
    """Raise a ScenarioError if there are missions, but fewer than egos."""
    drawn = drawn_mission(described)
    groups = [each.actor_count for each in described if isinstance(each, t.GroupedLapMission)]
    count = drawn.count if drawn else len(described) - len(groups) + sum(groups)
    if 0 < count < egos:
        raise ScenarioError(
            f"{egos} egos, but only {count} missions",
            place=f"{place}: ego_missions",
            remedy=f"use at most {count} egos, or add missions",
        )


def expand(missions: EgoMissions) -> tuple[t.AnyMission, ...]:
    """Return the missions with each group of lap missions replaced by its members'.

    Of missions that are drawn, those of the first set stand for all; before the build there is none.
    """
    expanded: list[t.AnyMission] = []
    for mission in missions:
        if isinstance(mission, t.DrawnMission):
            expanded += missions_of_set(mission, 0) if mission.sets else []
        else:
            expanded += grid(mission) if isinstance(mission, t.GroupedLapMission) else [mission]
    return tuple(expanded)


def grid(group: t.GroupedLapMission) -> list[t.LapMission]:
    """Return the missions of a group: the lanes in turn, each start `offset` behind the one before."""
    (begin, begin_lane, offset), (end, end_lane, goal) = group.route.begin, group.route.end
    laps = []
    for place in range(group.actor_count):
        route = replace(
            group.route,
            begin=(begin, (begin_lane + place) % group.lanes, offset - group.offset * place),
            end=(end, (end_lane + place) % group.lanes, goal),
        )
        laps.append(t.LapMission(route, group.num_laps, via=group.via, entry_tactic=group.entry_tactic))
    return laps
