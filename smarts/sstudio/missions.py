"""Missions on their map: the exact start, route and goal of each ego.

Resolved per episode, because random routes, random offsets and varied starts are drawn then.

Starts on one lane never overlap: `GAP` metres stay free behind the ego ahead, or as much as the scenario
itself leaves. A start is the place of the front bumper, on its lane; the rear bumper is on the lane too where
the lane is long enough: the least offset is the vehicle's length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

from numpy.random import Generator

from smarts.errors import ScenarioError
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.permissions import agent_roads
from smarts.sstudio import sstypes as t
from smarts.sstudio.episodes import expand
from smarts.sstudio.placement import (
    blame,
    lane_of,
    named_classes,
    next_lap,
    open_lane_of,
    route_edges,
    via_place,
)
from smarts.sstudio.random_routes import draw_route
from smarts.sstudio.sstypes.constants import MISSING, RANDOM_OFFSET, named_offset

GAP = 2.5
"""Free distance between egos that start on one lane, bumper to bumper [m]."""
CAR_LENGTH = 5.0
"""Default length of an ego [m]."""
ROUNDING = 1e-6
"""Overlap that is ignored, because offsets are scaled [m]."""
TRIES = 100
"""Draws of a random start until the search for room fails."""


@dataclass(frozen=True)
class LanePoint:
    """A point on a lane's centreline."""

    lane: int
    """Row of the lane."""
    s: float
    """Arc length from the lane's begin [m]."""

    def pose(self, roads: LaneGraph, behind: float = 0.0) -> tuple[float, float, float]:
        """Return x, y [m] and heading [rad], `behind` metres before the point."""
        return roads.pose_at(self.lane, self.s - behind)


@dataclass(frozen=True)
class PlacedVia:
    """A point to pass on the way."""

    point: LanePoint
    required_speed: float
    """[m/s]"""
    hit_distance: float
    """Distance within which it counts as passed [m]."""


@dataclass(frozen=True)
class PlacedMission:
    """A mission of one episode."""

    mission: t.AnyMission
    """The mission in the scenario."""
    start: LanePoint
    """Place of the front bumper."""
    speed: float
    """Speed at the start [m/s]."""
    goal: LanePoint | None
    """None for endless missions."""
    route: tuple[str, ...]
    """Ids of the road edges from start to goal, all laps; for endless missions the first one only."""
    via: tuple[PlacedVia, ...]
    start_time: float
    """The earliest time of entry [s]; 0 where the scenario names none."""


@dataclass(frozen=True)
class _Draft:
    """A mission whose start is not yet final."""

    mission: t.AnyMission
    route: t.Route | None
    lane: int
    s: float
    """Arc length of the front bumper in the scenario [m]."""
    where: str
    roads: LaneGraph
    """The map, as open to its vehicle."""
    users: str
    """Its vehicle, for errors."""


def place_missions(
    missions: Sequence[t.AnyMission],
    roads: LaneGraph,
    generator: Generator,
    variation: t.StartVariation | None = None,
    *,
    vehicle_length: float = CAR_LENGTH,
    kinds: Sequence[str] = (),
    net: Path | None = None,
    place: str = "",
) -> tuple[PlacedMission, ...]:
    """Return the missions of one episode, one for each ego.

    Args:
        missions: As one of the scenario's `mission_sets`; groups of lap missions count as their members.
        roads: The scenario's map.
        generator: Draws random routes and offsets, then starts, then speeds, each in the order of the egos.
        variation: How starts vary, or None to keep them.
        vehicle_length: The egos' length [m].
        kinds: SUMO's vehicle classes of the egos, by default passenger cars; they take ways open to them.
        net: The network that the map was read from; other vehicles than cars need it.
        place: The scenario's name, for errors.

    Raises:
        ScenarioError: A mission cannot be on this map, it is closed to its ego's vehicle, or two egos start
            in one place.
    """
    members = expand(missions)
    grounds = [(roads if net is None else agent_roads(roads, net, kind), kind) for kind in kinds]
    grounds += [(roads, "passenger")] * (len(members) - len(grounds))
    drafts = _drafts(members, grounds, generator, vehicle_length, place)
    starts = _spread_starts(drafts, roads, generator, variation, vehicle_length)
    speeds = [_speed(mission, generator, variation) for mission in members]
    return tuple(
        _placed(draft, s, speed, roads, generator, vehicle_length)
        for draft, s, speed in zip(drafts, starts, speeds, strict=True)
    )


def _drafts(
    missions: Sequence[t.AnyMission],
    grounds: Sequence[tuple[LaneGraph, str]],
    generator: Generator,
    length: float,
    place: str,
) -> list[_Draft]:
    """Return the missions with their starts; fixed starts are placed before random ones."""
    drafts: dict[int, _Draft] = {}
    for number in sorted(range(len(missions)), key=lambda number: _is_random(missions[number])):
        mission, where = missions[number], f"{place}: mission {number}"
        for _ in range(TRIES):
            draft = _draft(mission, *grounds[number], generator, length, where)
            others = [other for other in drafts.values() if other.lane == draft.lane]
            if not _is_random(mission) or all(abs(draft.s - other.s) >= length + GAP for other in others):
                drafts[number] = draft
                break
        else:
            raise ScenarioError(
                f"there is no room for a random start besides {len(drafts)} others",
                place=where,
                remedy="use fewer egos, or a larger map",
            )
    return [drafts[number] for number in range(len(missions))]


def _is_random(mission: t.AnyMission) -> bool:
    """Return whether a mission's start is drawn."""
    if isinstance(mission, t.EndlessMission):
        return mission.begin[2] == RANDOM_OFFSET
    return isinstance(mission.route, t.RandomRoute) or mission.route.begin[2] == RANDOM_OFFSET


def _draft(
    mission: t.AnyMission, roads: LaneGraph, kind: str, generator: Generator, length: float, where: str
) -> _Draft:
    users = named_classes([kind])
    if isinstance(mission, t.EndlessMission):
        route, begin = None, mission.begin
    elif isinstance(mission.route, t.RandomRoute):
        with blame(where):
            route = draw_route(roads, generator, users)
        begin = route.begin
    else:
        route, begin = mission.route, mission.route.begin
    lane = lane_of(roads, begin, where)
    if kind != "passenger":
        # Places of cars are checked when the scenario is built; other vehicles are known now.
        for end in (begin,) if route is None else (begin, route.end):
            open_lane_of(roads, end, where, users=users)
    s = _start_offset(roads, lane, begin[2], generator, length)
    return _Draft(mission, route, lane, s, where, roads, users)


def _start_offset(roads: LaneGraph, lane: int, offset: Any, generator: Generator, length: float) -> float:
    whole = float(roads.length[lane])
    least = min(length, whole)
    if isinstance(offset, str):
        return named_offset(offset, least, whole, generator.uniform)
    return max(roads.arc_length(lane, float(offset)), least)


def _spread_starts(
    drafts: Sequence[_Draft],
    roads: LaneGraph,
    generator: Generator,
    variation: t.StartVariation | None,
    length: float,
) -> list[float]:
    """Return where each ego's front bumper starts [m], drawn and then kept apart lane by lane."""
    reach = variation.offset if variation else 0.0
    drawn = [draft.s + float(generator.uniform(-reach, reach)) if reach else draft.s for draft in drafts]
    starts = list(drawn)
    rising = sorted(range(len(drafts)), key=lambda number: (drafts[number].lane, drafts[number].s))
    for lane, members in groupby(rising, key=lambda number: drafts[number].lane):
        queue = [*members]
        kept = keep_apart(
            [drafts[number].s for number in queue],
            [drawn[number] for number in queue],
            reach,
            float(roads.length[lane]),
            length,
        )
        if kept is None:
            raise _overlap([drafts[number] for number in queue], roads, length)
        for number, s in zip(queue, kept, strict=True):
            starts[number] = s
    return starts


def keep_apart(
    nominal: Sequence[float], drawn: Sequence[float], reach: float, lane_length: float, length: float
) -> list[float] | None:
    """Return starts on one lane near those drawn that keep their order and their gaps.

    Args:
        nominal: The starts that the scenario names, rising [m].
        drawn: Each within `reach` of its nominal start [m].
        reach: How far a start may be from its nominal one [m].
        lane_length: [m]
        length: Length of each vehicle [m].

    Returns:
        The starts, or None if two vehicles overlap where the scenario puts them.
    """
    gaps = [ahead - behind for behind, ahead in pairwise(nominal)]
    if any(gap < length - ROUNDING for gap in gaps):
        return None
    spacing = [min(gap, length + GAP) for gap in gaps]
    # From the rear, the least that each start can be once those behind it have their room; the scenario's
    # own starts are always feasible, so no bound passes them.
    least = [max(start - reach, min(start, length)) for start in nominal]
    for rank, room in enumerate(spacing):
        least[rank + 1] = max(least[rank + 1], least[rank] + room)
    # From the front, each start as drawn as far as the one ahead lets it.
    starts = list(drawn)
    ceiling = max(lane_length, nominal[-1])
    for rank in reversed(range(len(starts))):
        starts[rank] = min(max(drawn[rank], least[rank]), ceiling)
        ceiling = starts[rank] - spacing[rank - 1] if rank else ceiling
    return starts


def _overlap(queue: Sequence[_Draft], roads: LaneGraph, length: float) -> ScenarioError:
    behind, ahead = min(pairwise(queue), key=lambda pair: pair[1].s - pair[0].s)
    return ScenarioError(
        f"it starts at {behind.s:g} m on lane '{roads.lane_ids[behind.lane]}', and another at {ahead.s:g} m",
        place=behind.where,
        remedy=f"leave at least {length:g} m between the front bumpers of egos on one lane",
    )


def _speed(mission: t.AnyMission, generator: Generator, variation: t.StartVariation | None) -> float:
    """Return the speed at the start [m/s]: the mission's, else a varied one, else 0."""
    task = mission.task if isinstance(mission, t.Mission) else None
    if isinstance(task, t.UTurn) and task.initial_speed is not None:
        return task.initial_speed
    tactic = mission.entry_tactic
    if isinstance(tactic, t.TrapEntryTactic) and tactic.default_entry_speed is not None:
        return tactic.default_entry_speed
    return float(generator.uniform(*variation.speed)) if variation else 0.0


def _placed(
    draft: _Draft, s: float, speed: float, roads: LaneGraph, generator: Generator, length: float
) -> PlacedMission:
    start = LanePoint(draft.lane, s)
    return PlacedMission(
        mission=draft.mission,
        start=start,
        speed=speed,
        goal=None if draft.route is None else _goal(draft.route, roads, generator, draft.where),
        route=_route(draft, length),
        via=tuple(_via(via, roads, draft.where) for via in draft.mission.via),
        start_time=_start_time(draft.mission),
    )


def _goal(route: t.Route, roads: LaneGraph, generator: Generator, where: str) -> LanePoint:
    lane, offset = lane_of(roads, route.end, where), route.end[2]
    if isinstance(offset, str):
        return LanePoint(lane, named_offset(offset, 0.0, float(roads.length[lane]), generator.uniform))
    return LanePoint(lane, roads.arc_length(lane, offset))


def _route(draft: _Draft, vehicle_length: float) -> tuple[str, ...]:
    roads, users = draft.roads, draft.users
    if draft.route is None:
        return (roads.edge_ids[roads.lane_edge[draft.lane]],)
    mission = draft.mission
    if isinstance(mission, t.Mission) and isinstance(mission.task, t.UTurn):
        return (draft.route.begin[0], draft.route.end[0])  # the turn joins the two
    # A random route is drawn again where its goal is not ahead of its start.
    is_random = isinstance(mission, t.Mission) and isinstance(mission.route, t.RandomRoute)
    length = 0.0 if is_random else vehicle_length
    lap = route_edges(roads, draft.route, draft.where, vehicle_length=length, users=users)
    if not isinstance(mission, t.LapMission) or mission.num_laps == 1:
        return lap
    return lap + next_lap(roads, lap, draft.where, users) * (mission.num_laps - 1)


def _via(via: t.Via, roads: LaneGraph, where: str) -> PlacedVia:
    lane, offset = via_place(roads, via, where)
    within = via.hit_distance if via.hit_distance >= 0 else float(roads.width[lane]) / 2
    return PlacedVia(LanePoint(lane, roads.arc_length(lane, offset)), via.required_speed, within)


def _start_time(mission: t.AnyMission) -> float:
    tactic = mission.entry_tactic
    times = (getattr(mission, "start_time", MISSING), MISSING if tactic is None else tactic.start_time)
    return next((time for time in times if time != MISSING), 0.0)
