"""Sets of missions for several agents, drawn from lists of starts and goals when a scenario is built.

A way leads from a start to a goal lane by lane. The ways of two agents meet inside a junction, where their
lanes cross or merge, and on a road that both drive, where one comes from the other's right and leaves on its
left, or on its lane.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from smarts.arrays import Bools, Floats, Ints
from smarts.errors import ScenarioError
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.routes import CARS
from smarts.sstudio import sstypes as t
from smarts.sstudio.encoding import digest
from smarts.sstudio.missions import CAR_LENGTH, GAP, LanePoint
from smarts.sstudio.placement import lane_of, offset_along, route_edges
from smarts.types.streams import Purpose, stream

if TYPE_CHECKING:
    from numpy.random import Generator

SETS = 256
"""Sets that are drawn for a scenario."""
CHANGE_LENGTH = 40.0
"""Length of road that a lane change takes [m]."""
TRIES = 100
"""Draws of one set until the search for room fails."""


class Leg(NamedTuple):
    """A part of a way: one road, or one lane inside a junction."""

    lane: int
    """Lane on which it begins."""
    last: int
    """Lane on which it ends; another one of the road after lane changes."""
    reached: float
    """Time at which it is reached, driven at the limits [s]."""
    left: float
    """[s]"""


@dataclass(frozen=True)
class Way:
    """A way from a start to a goal."""

    start: int
    """Number among the starts, -1 for none of them."""
    goal: int
    """Number among the goals, -1 for none of them."""
    legs: tuple[Leg, ...]
    length: float
    """[m]"""


def with_sets(drawn: t.DrawnMission, roads: LaneGraph, seed: int, where: str) -> tuple[t.DrawnMission, str]:
    """Return the missions with their sets, and a note for the user that says what was drawn.

    Args:
        drawn: The missions; their places are on the map.
        roads: The map.
        seed: Seed of the build.
        where: Their place, for errors.

    Raises:
        ScenarioError: No way fits, no two ways meet, or there is no room for so many agents.
    """
    least, most = drawn.length
    ways = [way for way in find_ways(drawn, roads, where) if least <= way.length <= most]
    if not ways:
        problem = f"no way from a start to a goal is {least:g} to {most:g} m long"
        remedy = f"move them, with {CHANGE_LENGTH:g} m of road for each lane change"
        raise ScenarioError(problem, place=where, remedy=remedy)
    meets = meetings(roads, ways, drawn.arrivals)
    generator = stream(int(digest([seed, "ego_missions"], size=6), 16), Purpose.BUILD)
    sets = _draw_sets(drawn, meets, _exclusions(drawn, roads, ways, where), generator, where)
    share = np.mean([meets[np.ix_(each, each)].any() for each in sets])
    lengths = [way.length for way in ways]
    note = (
        f"ego_missions: {len(sets)} sets of {drawn.count}, drawn from {len(ways)} ways of "
        f"{min(lengths):.0f} to {max(lengths):.0f} m; in {share:.0%} of the sets two ways meet within "
        f"{drawn.arrivals:g} s"
    )
    pairs = tuple(tuple((ways[number].start, ways[number].goal) for number in each) for each in sets)
    return replace(drawn, sets=pairs), note


def find_ways(drawn: t.DrawnMission, roads: LaneGraph, where: str) -> Iterator[Way]:
    """Yield the ways from each start to each goal that need no more lane changes than roads have room for."""
    starts, goals = _points(roads, drawn.starts, where, CAR_LENGTH), _points(roads, drawn.goals, where, 0.0)
    for start, begin in enumerate(starts):
        for goal, end in enumerate(goals):
            try:
                route = t.Route(drawn.starts[start], drawn.goals[goal])
                edges = route_edges(roads, route, where, vehicle_length=CAR_LENGTH)
            except ScenarioError:
                continue
            numbers = [roads.edge_number(edge) for edge in edges]
            if way := way_between(roads, numbers, begin, end):
                yield replace(way, start=start, goal=goal)


def way_between(
    roads: LaneGraph,
    edges: Sequence[int],
    begin: LanePoint,
    end: LanePoint,
    change_length: float = CHANGE_LENGTH,
    entry: float = 0.0,
) -> Way | None:
    """Return the way of fewest lane changes along a route, None if the roads have no room for them.

    Args:
        roads: The map.
        edges: Numbers of the route's roads.
        begin: Where it starts.
        end: Its goal.
        change_length: Length of road that a lane change takes [m].
        entry: When the agent starts [s].
    """
    path = _lanes_of(roads, edges, begin, end, change_length)
    return Way(-1, -1, *_timed(roads, path, begin.s, end.s, entry)) if path else None


def _points(
    roads: LaneGraph, places: Sequence[tuple[str, int, float | str]], where: str, least: float
) -> list[LanePoint]:
    """Return places on their lanes, at least `least` metres from the lanes' begin."""
    lanes = [lane_of(roads, place, where) for place in places]
    offsets = [
        offset_along(place[2], float(roads.sumo_length[lane]), min)
        for place, lane in zip(places, lanes, strict=True)
    ]
    return [
        LanePoint(lane, max(roads.arc_length(lane, offset), min(least, float(roads.length[lane]))))
        for lane, offset in zip(lanes, offsets, strict=True)
    ]


Path = tuple[tuple[int, int], ...]
"""Lanes on which the parts of a way begin and end."""


def _lanes_of(
    roads: LaneGraph, edges: Sequence[int], begin: LanePoint, end: LanePoint, change_length: float
) -> Path:
    """Return the path of fewest lane changes over a route, empty if the roads have no room for them."""
    paths: dict[int, Path] = {begin.lane: ()}
    usable = np.isin(roads.kind, [*CARS])
    for number, edge in enumerate(edges):
        left: dict[int, Path] = {}
        for lane, path in paths.items():
            first = begin.s if number == 0 else 0.0
            room = (end.s if number == len(edges) - 1 else float(roads.length[lane])) - first
            for other in roads.edge_lanes(edge):
                if usable[other] and abs(other - lane) * change_length <= room:
                    _keep_best(left, other, (*path, (lane, other)))
        if number == len(edges) - 1:
            return left.get(end.lane, ())
        paths = {}
        for lane, path in left.items():
            for *inside, target in reversed([*roads.ways_from(lane, usable)]):
                if roads.lane_edge[target] == edges[number + 1]:
                    _keep_best(paths, target, (*path, *((each, each) for each in inside)))
    return ()


def _keep_best(paths: dict[int, Path], lane: int, path: Path) -> None:
    """Keep a path to a lane if it is the first one, or has fewer lane changes."""
    if lane not in paths or _changes(path) < _changes(paths[lane]):
        paths[lane] = path


def _changes(path: Path) -> int:
    return sum(abs(last - first) for first, last in path)


def _timed(
    roads: LaneGraph, path: Path, begin: float, end: float, time: float
) -> tuple[tuple[Leg, ...], float]:
    """Return a path with its times, and its length [m].

    Args:
        roads: The map.
        path: The path.
        begin: Arc length of the start on the first lane [m].
        end: Arc length of the goal on the last lane [m].
        time: When the agent starts [s].
    """
    legs, length = [], 0.0
    for number, (lane, last) in enumerate(path):
        until = end if number == len(path) - 1 else float(roads.length[lane])
        span = until - (begin if number == 0 else 0.0)
        reached, time = time, time + span / float(roads.speed_limit[lane])
        length += span
        legs.append(Leg(lane, last, reached, time))
    return tuple(legs), length


def meetings(roads: LaneGraph, ways: Sequence[Way], arrivals: float) -> Bools:
    """Return which ways meet where both agents arrive within a time [s], shape (W, W)."""
    meets = np.zeros((len(ways), len(ways)), np.bool_)
    inside: dict[int, list[tuple[int, float]]] = defaultdict(list)
    shared: dict[int, list[tuple[int, int, int, float]]] = defaultdict(list)
    for number, way in enumerate(ways):
        for leg in way.legs:
            if roads.is_internal[leg.lane]:
                inside[leg.lane].append((number, leg.reached))
            else:
                shared[int(roads.lane_edge[leg.lane])].append((number, leg.lane, leg.last, leg.left))
    for lane, users in inside.items():
        for row in range(roads.conflict_start[lane], roads.conflict_start[lane + 1]):
            other = int(roads.conflict_lane[row])
            if other in inside:
                numbers, times = _arrivals(roads, users, lane, roads.conflict_extent[row])
                others, theirs = _arrivals(roads, inside[other], other, roads.conflict_other_extent[row])
                meets[np.ix_(numbers, others)] |= np.abs(times[:, None] - theirs) <= arrivals
    for users in shared.values():
        numbers, first, last, times = map(np.array, zip(*users, strict=True))
        begins, ends = first[:, None] - first, last[:, None] - last
        crossing = (begins != 0) & (np.sign(begins) != np.sign(ends))
        meets[np.ix_(numbers, numbers)] |= crossing & (np.abs(times[:, None] - times) <= arrivals)
    return meets


def _arrivals(
    roads: LaneGraph, users: Sequence[tuple[int, float]], lane: int, extent: Floats
) -> tuple[Ints, Floats]:
    """Return the ways that use a junction's lane, and when they reach a conflict on it [s]."""
    numbers, reached = map(np.array, zip(*users, strict=True))
    return numbers, reached + extent[0] / roads.speed_limit[lane]


def _exclusions(drawn: t.DrawnMission, roads: LaneGraph, ways: Sequence[Way], where: str) -> Bools:
    """Return which ways cannot be those of two agents: equal or near starts, or equal goals, shape (W, W)."""
    points = [_points(roads, drawn.starts, where, CAR_LENGTH)[way.start] for way in ways]
    lanes, offsets = np.array([each.lane for each in points]), np.array([each.s for each in points])
    goals = np.array([way.goal for way in ways])
    near = np.abs(offsets[:, None] - offsets) < CAR_LENGTH + GAP
    return (lanes[:, None] == lanes) & near | (drawn.distinct & (goals[:, None] == goals))


def _draw_sets(
    drawn: t.DrawnMission, meets: Bools, excluded: Bools, generator: Generator, where: str
) -> list[list[int]]:
    """Return sets of numbers of ways; the two that have to meet come first."""
    pairs = np.argwhere(meets & ~excluded)
    wanted = drawn.conflicts * SETS if drawn.count > 1 else 0.0
    if wanted and not len(pairs):
        problem = f"no two ways meet within {drawn.arrivals:g} s, and conflicts is {drawn.conflicts:g}"
        raise ScenarioError(problem, place=where, remedy="add starts and goals, or give conflicts=0")
    sets = []
    for number in range(SETS):
        for _ in range(TRIES):
            first = pairs[generator.integers(len(pairs))].tolist() if number < wanted else []
            chosen = _filled(first, drawn.count, excluded, generator)
            if len(chosen) == drawn.count:
                break
        else:
            problem = f"there is no room for {drawn.count} agents"
            raise ScenarioError(problem, place=where, remedy="add starts and goals, or lower count")
        sets.append(chosen)
    return sets


def _filled(chosen: list[int], count: int, excluded: Bools, generator: Generator) -> list[int]:
    """Return some ways with more of them drawn, up to `count` or until none is left that fits."""
    while len(chosen) < count:
        free = np.flatnonzero(~excluded[np.array(chosen, int)].any(axis=0))
        if not len(free):
            break
        chosen = [*chosen, int(free[generator.integers(len(free))])]
    return chosen
