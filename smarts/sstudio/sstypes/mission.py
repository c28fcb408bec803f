"""Missions: what an agent has to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from smarts.sstudio.sstypes.constants import MISSING
from smarts.sstudio.sstypes.entry_tactic import EntryTactic
from smarts.sstudio.sstypes.identity import Described
from smarts.sstudio.sstypes.renaming import formerly
from smarts.sstudio.sstypes.route import JunctionEdgeIDResolver, RandomRoute, Route


@formerly(edge_id="road_id")
@dataclass(frozen=True, eq=False)
class Via(Described):
    """A point to pass on the way."""

    road_id: str | JunctionEdgeIDResolver
    """Its edge; formerly `edge_id`."""
    lane_index: int
    """Its lane, 0 is the rightmost."""
    lane_offset: float
    """Offset along the lane [m]."""
    required_speed: float
    """The speed to pass it with [m/s]."""
    hit_distance: float = -1
    """Distance within which it counts as passed [m]; negative: half the lane's width."""


@dataclass(frozen=True, eq=False)
class UTurn(Described):
    """The task to make a U-turn: the route is the first road and the last road, which the turn joins.

    The turn is triggered when a vehicle on the last road is within `trigger_radius` and that road is beside
    the agent's; without such a vehicle nothing is triggered, as in the original. Then the waypoint paths are
    replaced by one path: the current lane at the turning speed, then a curve into the opposite lane
    (`world.guidance`). `Lane` and `LaneWithContinuousSpeed` execute the turn while the action is `keep_lane`;
    with other action types the agent has to follow the path itself. The agent is responsible for avoiding
    collisions. The vehicle turns only where the whole curve is on the road, and slows down before a gap in a
    median; a first road without such a place is an error. The lanes must be at least two turning radii of the
    vehicle apart, about 10 m for a car.
    """

    trigger_radius: float = 100
    """Distance of a vehicle on the last road that triggers the turn [m]."""
    initial_speed: float | None = None
    """The speed at the start, and all waypoints' limit until the turn is triggered [m/s]."""
    target_lane_index: int = 0
    """The lane of the last road to turn into, 0 is the rightmost; the leftmost if there are fewer."""

    @property
    def name(self) -> str:
        """The task's name."""
        return "uturn"


@dataclass(frozen=True, eq=False)
class CutIn(Described):
    """The task to cut in ahead of the nearest vehicle in a neighbouring lane.

    The task is triggered when such a vehicle is within `trigger_radius`. Then the waypoint paths are replaced
    by one path (`world.guidance`): the current lane, at speeds of up to twice the other vehicle's that bring
    the agent 15 m ahead of it, from centre to centre, or into the middle of a gap below 30 m; then a curve of
    3 s into the other lane. The curve begins only if no vehicle would need to brake harder than 4 m/s^2
    (`smarts.sim.gaps`): neither the agent behind the leaders in both lanes, nor the follower in the other
    lane. A vehicle with that much room ahead of it is preferred; without one, the agent stays in its lane.
    The speeds also keep a distance to the leader, during the curve in both lanes. `Lane` and
    `LaneWithContinuousSpeed` execute the task, at most at these speeds, while the action is `keep_lane`; with
    other action types the agent has to follow the path itself. Discrete lane actions do not exceed the speed
    limit, even if the other vehicle drives at it. After the curve the task is over. The agent is responsible
    for avoiding collisions.

    Whether an agent cut in is measured from the record (`smarts-bench` metric `cut_in_ratio`). The original
    took the distance from the agent's aggressiveness (20 m to 10 m) and had no radius in effect.
    """

    trigger_radius: float = 30
    """Distance of the other vehicle that triggers the task [m]."""
    complete_on_edge_id: str | JunctionEdgeIDResolver | None = None
    """The edge on which the task is over, whether it cut in or not."""

    @property
    def name(self) -> str:
        """The task's name."""
        return "cut_in"


@dataclass(frozen=True, eq=False)
class Mission(Described):
    """Drive a route to its end."""

    route: Route | RandomRoute
    """The route; the front bumper starts at its begin, or further on so that the vehicle fits on the lane."""
    via: Sequence[Via] = ()
    """Points to pass."""
    start_time: float = MISSING
    """Earliest begin of the mission [s]; default: the entry tactic's, else the episode's."""
    entry_tactic: EntryTactic | None = None
    """How the agent gets its vehicle; default: a new one is added."""
    task: UTurn | CutIn | None = None
    """A manoeuvre to perform on the way."""


@dataclass(frozen=True, eq=False)
class EndlessMission(Described):
    """Drive without a goal."""

    begin: tuple[str, int, Any]
    """Edge, lane index and offset of the start, as `Route.begin`."""
    via: Sequence[Via] = ()
    """Points to pass."""
    start_time: float = MISSING
    """As in `Mission`."""
    entry_tactic: EntryTactic | None = None
    """As in `Mission`."""


@dataclass(frozen=True, eq=False)
class LapMission(Described):
    """Drive a closed route several times."""

    route: Route
    """One lap."""
    num_laps: int
    """Number of laps."""
    via: Sequence[Via] = ()
    """Points to pass in every lap."""
    start_time: float = MISSING
    """As in `Mission`."""
    entry_tactic: EntryTactic | None = None
    """As in `Mission`."""


@dataclass(frozen=True, eq=False)
class GroupedLapMission(Described):
    """Lap missions of several agents that start staggered on a grid."""

    route: Route
    """One lap of the first agent; the others begin behind and beside it."""
    offset: float
    """Distance from each start to the one ahead [m]."""
    lanes: int
    """Number of lanes of the grid."""
    actor_count: int
    """Number of agents."""
    num_laps: int
    """Number of laps."""
    via: Sequence[Via] = ()
    """Points to pass in every lap."""
    entry_tactic: EntryTactic | None = None
    """As in `Mission`."""


AnyMission = Mission | EndlessMission | LapMission | GroupedLapMission


@dataclass(frozen=True, eq=False)
class DrawnMission(Described):
    """Missions of all agents, drawn from lists of starts and goals in every episode (an extension).

    It is the only one of a scenario's `ego_missions`. The build finds the ways from a start to a goal that
    fit, draws sets of them, and notes the shares. Every episode takes one of the sets, and deals its
    missions to the agents in a new order. Fewer agents take the first missions of a set.
    """

    starts: Sequence[tuple[str, int, Any]]
    """Where agents may start, as `Route.begin`, without "random". No two of a set are within 7.5 m."""
    goals: Sequence[tuple[str, int, Any]]
    """Where they may have to go, as `starts`."""
    distinct: bool = True
    """Whether no two agents of an episode have the same goal."""
    count: int = 4
    """Number of missions of a set: the most agents that the scenario has room for."""
    length: tuple[float, float] = (80.0, 250.0)
    """The least and the largest length of a way [m]. A way has at most one lane change in 40 m of a road."""
    conflicts: float = 0.7
    """Least share of sets in which the ways of two agents meet, within `arrivals`. These two come first."""
    arrivals: float = 5.0
    """Most time between their arrivals where their ways meet, if each drives at the limits [s]."""
    sets: Sequence[Sequence[tuple[int, int]]] = ()
    """Written by the build: numbers of start and goal of each mission of each set."""
