"""What ends an agent's episode; names and defaults of the fields are the original's."""

from __future__ import annotations

from typing import Annotated

from smarts.agents.checks import Listed, NumberFrom0, WholeFrom0, checked
from smarts.types.events import Event


@checked
class AgentsListAlive:
    """Some egos, and how many of them must be left."""

    agents_list: Annotated[tuple[str, ...], Listed]
    """Their names; any sequence will do."""
    minimum_agents_alive_in_list: WholeFrom0


@checked
class AgentsAliveDoneCriteria:
    """The agent ends when too few others are left; None: no limit."""

    minimum_ego_agents_alive: WholeFrom0 | None = None
    """Least number of egos."""
    minimum_total_agents_alive: WholeFrom0 | None = None
    """Least number of all agents."""
    agent_lists_alive: Annotated[tuple[AgentsListAlive, ...] | None, Listed] = None
    """Each is a condition of its own."""


@checked
class InterestDoneCriteria:
    """The agent ends when the vehicles of interest are gone."""

    actors_filter: Annotated[tuple[str, ...], Listed] = ()
    """Patterns (regular expressions) that names of vehicles of interest to this agent begin with."""
    include_scenario_marked: bool = True
    """Whether those that the scenario marks are of interest too."""
    strict: bool = False
    """Whether to end at once if there is none at the beginning."""


@checked
class EventConfiguration:
    """When events happen."""

    not_moving_time: NumberFrom0 = 60
    """How long a vehicle has to stay within `not_moving_distance` not to be moving [s]; may be infinite.

    Time does not count within 40 m of a red light, nor while another vehicle stands less than 10 m ahead,
    nor at a junction while moving vehicles are about to cross the way ahead.
    """
    not_moving_distance: NumberFrom0 = 1
    """[m]"""


@checked
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
