"""What ends an agent's episode; names and defaults of the fields are the original's."""

from __future__ import annotations

import re
from dataclasses import dataclass

from smarts.agents.checks import (
    InterfaceError,
    check_instance,
    check_list,
    check_truth,
    check_whole,
    keep_number,
)
from smarts.types.events import Event

MOST_AGENTS = 10_000
"""The most agents of a simulation."""
LARGEST_DISTANCE = 1e6
"""[m]"""


@dataclass(frozen=True)
class AgentsListAlive:
    """Some egos, and how many of them must be left."""

    agents_list: tuple[str, ...]
    """Their names; any sequence will do."""
    minimum_agents_alive_in_list: int

    def __post_init__(self) -> None:
        place, least = "AgentsListAlive", self.minimum_agents_alive_in_list
        check_list("agents_list", self.agents_list, str, "['ego-0', 'ego-1']", place)
        check_whole("minimum_agents_alive_in_list", least, 0, MOST_AGENTS, place)
        object.__setattr__(self, "agents_list", tuple(self.agents_list))


@dataclass(frozen=True)
class AgentsAliveDoneCriteria:
    """The agent ends when too few others are left; None: no limit."""

    minimum_ego_agents_alive: int | None = None
    """Least number of egos."""
    minimum_total_agents_alive: int | None = None
    """Least number of all agents."""
    agent_lists_alive: tuple[AgentsListAlive, ...] | None = None
    """Each is a condition of its own."""

    def __post_init__(self) -> None:
        place = "AgentsAliveDoneCriteria"
        for name in ("minimum_ego_agents_alive", "minimum_total_agents_alive"):
            if getattr(self, name) is not None:
                check_whole(name, getattr(self, name), 0, MOST_AGENTS, place)
        if self.agent_lists_alive is not None:
            example = "[AgentsListAlive(['ego-0'], 1)]"
            check_list("agent_lists_alive", self.agent_lists_alive, AgentsListAlive, example, place)
            object.__setattr__(self, "agent_lists_alive", tuple(self.agent_lists_alive))


@dataclass(frozen=True)
class InterestDoneCriteria:
    """The agent ends when the vehicles of interest are gone."""

    actors_filter: tuple[str, ...] = ()
    """Patterns (regular expressions) that names of vehicles of interest to this agent begin with."""
    include_scenario_marked: bool = True
    """Whether those that the scenario marks are of interest too."""
    strict: bool = False
    """Whether to end at once if there is none at the beginning."""

    def __post_init__(self) -> None:
        place = "InterestDoneCriteria"
        check_list("actors_filter", self.actors_filter, str, "['ego-.*']", place)
        for pattern in self.actors_filter:
            _check_pattern(pattern, place)
        check_truth("include_scenario_marked", self.include_scenario_marked, place)
        check_truth("strict", self.strict, place)
        object.__setattr__(self, "actors_filter", tuple(self.actors_filter))


def _check_pattern(pattern: str, place: str) -> None:
    try:
        re.compile(pattern)
    except re.error as error:
        raise InterfaceError(
            f"{pattern!r} in actors_filter is not a pattern: {error}",
            place=place,
            remedy="give regular expressions, such as 'ego-.*'",
        ) from error


@dataclass(frozen=True)
class EventConfiguration:
    """When events happen."""

    not_moving_time: float = 60
    """How long a vehicle has to stay within `not_moving_distance` not to be moving [s]; may be infinite.

    Time does not count within 40 m of a red light, nor while another vehicle stands less than 10 m ahead,
    nor at a junction while moving vehicles are about to cross the way ahead.
    """
    not_moving_distance: float = 1
    """[m]"""

    def __post_init__(self) -> None:
        keep_number(self, "not_moving_time")
        keep_number(self, "not_moving_distance", most=LARGEST_DISTANCE)


@dataclass(frozen=True)
class DoneCriteria:
    """Which events end the agent's episode. A goal reached or missed, and the limit of steps, always do."""

    collision: bool = True
    off_road: bool = True
    off_route: bool = True
    on_shoulder: bool = False
    wrong_way: bool = False
    not_moving: bool = False
    agents_alive: AgentsAliveDoneCriteria | None = None
    interest: InterestDoneCriteria | None = None

    def __post_init__(self) -> None:
        for name in ("collision", "off_road", "off_route", "on_shoulder", "wrong_way", "not_moving"):
            check_truth(name, getattr(self, name), "DoneCriteria")
        for name, kind in (("agents_alive", AgentsAliveDoneCriteria), ("interest", InterestDoneCriteria)):
            if getattr(self, name) is not None:
                check_instance(name, getattr(self, name), kind, f"{kind.__name__}(...)", "DoneCriteria")

    @property
    def events(self) -> Event:
        """The events as bits."""
        switches = {
            Event.COLLISION: self.collision,
            Event.OFF_ROAD: self.off_road,
            Event.OFF_ROUTE: self.off_route,
            Event.ON_SHOULDER: self.on_shoulder,
            Event.WRONG_WAY: self.wrong_way,
            Event.NOT_MOVING: self.not_moving,
            Event.AGENTS_ALIVE_DONE: self.agents_alive is not None,
            Event.INTEREST_DONE: self.interest is not None,
        }
        chosen = Event.REACHED_GOAL | Event.MISSED_GOAL | Event.REACHED_MAX_EPISODE_STEPS
        for event, is_on in switches.items():
            chosen |= event if is_on else Event.NONE
        return chosen
