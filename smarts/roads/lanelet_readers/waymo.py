"""Maps of the Waymo Open Motion Dataset, in its scenarios; `smarts.roads.waymo_scenarios` names the sources.

Lanes are side by side on a part of their way only, so they are cut where it begins and ends: lane 7 becomes
the lanelets 7, 7_40, ..., named by the point at which they begin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

from smarts.arrays import Floats
from smarts.geometry.polylines import headings
from smarts.roads.lane_graph import LaneKind
from smarts.roads.lanelets import URBAN, Lanelet
from smarts.roads.waymo_scenarios import Message, first, read_scenario

MILE_PER_HOUR = 0.44704
"""[m/s]"""
BICYCLE = 3
"""Type of a lane."""
WIDTH, NARROWEST, WIDEST = 3.5, 2.6, 4.5
"""Width of lanes without boundaries, as in junctions; others have at least and at most so much [m]."""
SHORTEST, NEAR = 30, 10
"""Lanes are side by side on at least so much of their way, as they are not where they fork; cuts are at least
so far apart [points, every 0.5 m]."""
_Pair = tuple[int, int, int, int, int, int]
"""A lane, its first and its last point that are beside another lane; that lane, its first and last point."""


def read(path: Path) -> list[Lanelet]:
    """Return the lanes of a scenario, FILE#ID.

    Raises:
        ValueError: There is no such scenario, or it is broken.
    """
    scenario = read_scenario(path)
    lanes: dict[int, tuple[Message, Floats]] = {}
    edges: dict[int, shapely.LineString] = {}
    for feature in scenario["features"]:
        for each in (*feature["lane"], *feature["line"]):
            line = np.array([[first(point, axis) for axis in "xy"] for point in each["polyline"]], float)
            if len(line) > 1 and np.ptp(line, axis=0).any():
                edges[first(feature, "id")] = shapely.LineString(line)
                lanes |= {first(feature, "id"): (each, line)} if feature["lane"] else {}
    lengths = {name: len(line) for name, (_, line) in lanes.items()}
    pairs = _pairs(lanes, lengths)
    cuts = _cuts(lengths, pairs)
    lit = {str(first(each, "lane")) for step in scenario["lights"] for each in step["lanes"]}
    found, taken = [], {""}
    for name, (lane, line) in lanes.items():
        half = _width(lane, line, edges) / 2
        aside = half * np.column_stack([-np.sin(headings(line)), np.cos(headings(line))])
        speed = first(lane, "mph") * MILE_PER_HOUR
        kind = LaneKind.BICYCLE if first(lane, "type") == BICYCLE else LaneKind.CAR
        exits = tuple(str(other) for other in lane["exit_lanes"] if other in lanes)
        for begin, end in pairwise(cuts[name]):
            after = exits if end == cuts[name][-1] else (_name(name, end),)
            lights = tuple(each for each in after if each in lit)
            beside = _left((name, begin, end), pairs, cuts)
            bounds = (line + aside)[begin : end + 1], (line - aside)[begin : end + 1]
            beside = "" if beside in taken else beside
            taken.add(beside)
            more = {"lights": lights, "assumes_limit": not speed}
            found.append(Lanelet(_name(name, begin), *bounds, after, beside, speed or URBAN, kind, **more))
    return found


def _name(lane: int, begin: int) -> str:
    return f"{lane}_{begin}" if begin else f"{lane}"


def _pairs(lanes: Mapping[int, tuple[Message, Floats]], lengths: Mapping[int, int]) -> list[_Pair]:
    """Return the parts of lanes that are beside a lane on their left."""
    found = []
    for name, (lane, _) in lanes.items():
        for each in lane["left"]:
            other, begin, end, *its = (first(each, field) for field in each)
            pair = name, begin, end, other, *its
            if all(at + SHORTEST <= to < lengths.get(of, 0) for of, at, to in (pair[:3], pair[3:])):
                found.append(pair)
    return found


def _beside(point: int, pair: _Pair) -> int:
    """Return the point of a pair's second lane that is beside a point of the first."""
    return round(pair[4] + (point - pair[1]) * (pair[5] - pair[4]) / (pair[2] - pair[1]))


def _cuts(lengths: Mapping[int, int], pairs: Sequence[_Pair]) -> dict[int, list[int]]:
    """Return the points at which each lane begins, is cut, and ends."""
    both = [*pairs, *((*pair[3:], *pair[:3]) for pair in pairs)]
    cuts = {name: [0, length - 1] for name, length in lengths.items()}
    todo = [(pair[0], at) for pair in both for at in pair[1:3]]
    while todo:
        name, at = todo.pop()
        if min(abs(at - cut) for cut in cuts[name]) >= NEAR:
            cuts[name] = sorted([*cuts[name], at])
            there = (pair for pair in both if pair[0] == name and pair[1] <= at <= pair[2])
            todo += [(pair[3], _beside(at, pair)) for pair in there]
    return cuts


def _left(part: tuple[int, int, int], pairs: Sequence[_Pair], cuts: Mapping[int, Sequence[int]]) -> str:
    """Return the lanelet on the left of a part of a lane, "" if there is none."""
    lane, begin, end = part
    for pair in pairs:
        if pair[0] == lane and pair[1] - NEAR < begin and end < pair[2] + NEAR:
            for ends in pairwise(cuts[pair[3]]):
                if max(abs(_beside(begin, pair) - ends[0]), abs(_beside(end, pair) - ends[1])) < 2 * NEAR:
                    return _name(pair[3], ends[0])
    return ""


def _width(lane: Message, line: Floats, edges: Mapping[int, shapely.LineString]) -> float:
    """Return the width between a lane's boundaries, or twice the distance of the one that it has [m]."""
    halves = []
    for side in ("left_boundaries", "right_boundaries"):
        bounds = [edges[name] for each in lane[side] if (name := first(each, "feature")) in edges]
        if bounds:
            halves.append(np.median(shapely.distance(shapely.points(line), shapely.union_all(bounds))))
    return float(np.clip(2 * np.mean(halves), NARROWEST, WIDEST)) if halves else WIDTH
