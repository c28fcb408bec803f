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
    """The task to turn round: the route is its first road and its last, the turn the way between them."""

    trigger_radius: float = 100
    """Without effect: when to turn is for the agent to decide. Kept so that the original's calls work [m]."""
    initial_speed: float | None = None
    """The speed before the turn [m/s]."""
    target_lane_index: int = 0
    """Without effect: the route's end says in which lane the goal is. Kept as above."""

    @property
    def name(self) -> str:
        """The task's name."""
        return "uturn"


@dataclass(frozen=True, eq=False)
class CutIn(Described):
    """A label of missions whose point is cutting in; it has no effect on observations, events or ends.

    In the original it bends the waypoints into the lane of the nearest vehicle. Here nothing plans for
    the agent: whether it cut in is measured from the record (`smarts-bench` metric `cut_in_ratio`).
    """

    trigger_radius: float = 30
    """Checked, and without effect [m]."""
    complete_on_edge_id: str | JunctionEdgeIDResolver | None = None
    """Checked to be an edge of the map, and without effect."""

    @property
    def name(self) -> str:
        """The task's name."""
        return "cut_in"


@dataclass(frozen=True, eq=False)
class Mission(Described):
    """Drive a route to its end."""

    route: Route | RandomRoute
    """The way."""
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
