"""What an agent is asked to do."""

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
    """How far along the lane [m]."""
    required_speed: float
    """The speed to pass it with [m/s]."""
    hit_distance: float = -1
    """Within which distance it counts as passed [m]; negative is half the lane's width."""


@dataclass(frozen=True, eq=False)
class UTurn(Described):
    """The task to turn round: the route is its first road and its last, the turn the way between them.

    As soon as a vehicle on the last road is within `trigger_radius`, and that road is beside the agent's, the
    agent's waypoint paths are one: its lane, at the speed that the turn takes, and once it is that slow, a
    curve from where it is into the lane across (`world.guidance`). The lane controllers follow it: `Lane` and
    `LaneWithContinuousSpeed` turn round while they are told to keep the lane. An agent that acts otherwise
    has to follow the path itself. To mind the others is the agent's part. Without a vehicle on the last road
    nothing is triggered, as in the original. It turns only where there is road all along the curve, slowing
    down towards a break in a median; a first road without such a place is refused. The lanes must be at least
    two turning radii of the vehicle apart, about 10 m for a car.
    """

    trigger_radius: float = 100
    """Within which a vehicle on the last road triggers the turn [m]."""
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
    """The task to cut in on the nearest vehicle in a lane beside the agent's.

    As soon as one is within `trigger_radius`, the agent's waypoint paths are one: its lane, at speeds (up to
    twice the other's) that bring it 15 m ahead of the other, from centre to centre, or into the middle of a
    gap below 30 m, and from there a curve of 3 s into the other's lane (`world.guidance`). The curve begins
    only where nobody would have to brake harder than 4 m/s^2 for it (`smarts.sim.gaps`): the agent behind
    those ahead in both lanes, and who is behind it in the other's. A vehicle with that much room before it is
    preferred; where there is none, the agent stays beside. The speeds also keep it from who is ahead in its
    lane, and in the other's during the curve. The lane controllers follow it, at most at these speeds:
    `Lane` and `LaneWithContinuousSpeed` cut in while they are told to keep the lane. An agent that acts
    otherwise has to follow the path itself. Discrete lane actions do not exceed the speed limit even if the
    other drives at it. Behind the curve the task is over, and to mind the others is the agent's part.

    Whether an agent cut in is measured from the record (`smarts-bench` metric `cut_in_ratio`). The original
    took the distance from the agent's aggressiveness (20 m to 10 m) and had no radius in effect.
    """

    trigger_radius: float = 30
    """Within which the other vehicle triggers the task [m]."""
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
    """The way; the front bumper starts at its begin, or as far on as it takes to be all on the lane."""
    via: Sequence[Via] = ()
    """Points to pass."""
    start_time: float = MISSING
    """When the mission begins at the earliest [s]; unless given, the entry tactic's, or with the episode."""
    entry_tactic: EntryTactic | None = None
    """How the agent gets its vehicle; unless given, a new one is put in."""
    task: UTurn | CutIn | None = None
    """A manoeuvre to perform on the way."""


@dataclass(frozen=True, eq=False)
class EndlessMission(Described):
    """Drive on for ever."""

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
    """How many times."""
    via: Sequence[Via] = ()
    """Points to pass in every lap."""
    start_time: float = MISSING
    """As in `Mission`."""
    entry_tactic: EntryTactic | None = None
    """As in `Mission`."""


@dataclass(frozen=True, eq=False)
class GroupedLapMission(Described):
    """Lap missions of several agents, who start staggered on a grid."""

    route: Route
    """One lap of the first agent; the others begin behind and beside it."""
    offset: float
    """How far each starts behind the one before [m]."""
    lanes: int
    """Over how many lanes they are spread."""
    actor_count: int
    """How many agents."""
    num_laps: int
    """How many laps."""
    via: Sequence[Via] = ()
    """Points to pass in every lap."""
    entry_tactic: EntryTactic | None = None
    """As in `Mission`."""


AnyMission = Mission | EndlessMission | LapMission | GroupedLapMission
