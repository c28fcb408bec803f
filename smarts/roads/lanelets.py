"""Maps of lanelets, which are lanes with a left and a right bound, as SUMO's plain XML for netconvert.

Lanes keep their centrelines, as the mean of their bounds, and get a constant width, the median distance of
the bounds. netconvert gives the junctions their lanes, right of way and outlines.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import shapely

from smarts.arrays import Floats
from smarts.geometry.polylines import arc_lengths, without_repeats
from smarts.registry import Registry
from smarts.roads.lane_graph import LaneKind

LANELET_MAPS = Registry("map of lanelets", {"commonroad": "smarts.roads.lanelet_readers.commonroad:read"})
"""Kind of a map's source -> its reader."""
NODE_DEPTH = 0.5
"""How far the outline of a node reaches into its lanes [m]. netconvert cuts lanes at the outline; those that
it draws itself swallow ramps."""
URBAN, MOTORWAY = 50 / 3.6, 130 / 3.6
"""Limits where a map names none [m/s]."""
_ALLOW = {LaneKind.BUS: "bus coach", LaneKind.BICYCLE: "bicycle", LaneKind.FOOT: "pedestrian"}


@dataclass(frozen=True, eq=False)
class Lanelet:
    """A part of a lane."""

    id: str
    left: Floats
    """Bound on the left [m], in driving direction, shape (P, 2)."""
    right: Floats
    """Bound on the right [m], shape (P', 2)."""
    successors: tuple[str, ...] = ()
    left_neighbour: str = ""
    """The lanelet on the left that leads in the same direction, "" for none."""
    speed: float = URBAN
    """Limit [m/s]."""
    kind: LaneKind = LaneKind.CAR
    inside: bool = False
    """Whether the map says that it lies inside a junction."""


def plain_xml(lanelets: Sequence[Lanelet]) -> dict[str, str]:
    """Return the texts of SUMO's node, edge and connection files: "nod", "edg", "con".

    Neighbours make an edge, `road-A-B-C` from right to left. A lanelet inside a junction that crosses
    another is drawn as a connection, so that their traffic conflicts; all others are edges.
    """
    network = _Network(lanelets)
    files = {"nod": network.nodes(), "edg": network.edges(), "con": network.connections()}
    return {part: tostring(root, "unicode") for part, root in files.items()}


class _Lane(NamedTuple):
    """The place of a lanelet in SUMO's network."""

    edge: str
    index: int
    """Place across the edge, 0 is the rightmost."""


class _Turn(NamedTuple):
    """A connection from a lanelet to another."""

    source: str
    target: str
    via: str
    """The lanelet inside the junction that it is drawn as, the target if there is none."""


class _Network:
    """SUMO's network of a map of lanelets."""

    def __init__(self, lanelets: Sequence[Lanelet]) -> None:
        self.by_id = {each.id: each for each in lanelets}
        self.lines = {each.id: _centreline(each) for each in lanelets}
        self.widths = {each.id: _width(each) for each in lanelets}
        pairs = self._crossing()
        crossing = {one for pair in pairs for one in pair}
        # Edge -> its lanelets, from right to left.
        groups: dict[str, list[str]] = {}
        beside = {each.left_neighbour for each in lanelets}
        for first in (each.id for each in lanelets if each.id not in crossing | beside):
            group = [first]
            while self.by_id[group[-1]].left_neighbour:
                group.append(self.by_id[group[-1]].left_neighbour)
            groups[f"road-{'-'.join(group)}"] = group
        self.groups = groups
        self.lanes = {name: _Lane(edge, k) for edge in groups for k, name in enumerate(groups[edge])}
        self.turns = [
            _Turn(source, target, via)
            for source in self.lanes
            for via in self.by_id[source].successors
            for target in (self.by_id[via].successors if via in crossing else (via,))
        ]
        self.node_of = self._joined_ends(pairs)

    def _crossing(self) -> list[tuple[str, str]]:
        """Return the pairs of lanelets that become connections.

        They are single, lead from an edge to an edge, and cross each other but come from elsewhere. That a
        map calls a lanelet part of a junction is not enough: ramps are called so, too, and netconvert bends
        connections.
        """
        before: dict[str, set[str]] = {name: set() for name in self.by_id}
        for each in self.by_id.values():
            for target in each.successors:
                before[target].add(each.id)
        beside = {each.left_neighbour for each in self.by_id.values()}
        single = {
            each.id
            for each in self.by_id.values()
            if each.inside and not each.left_neighbour and each.id not in beside
            if each.successors and before[each.id]
            if not any(self.by_id[other].inside for other in (*each.successors, *before[each.id]))
        }
        names = list(self.by_id)
        shapes = [shapely.LineString(self.lines[name]) for name in names]
        pairs = shapely.STRtree(shapes).query(shapes, predicate="crosses").T
        crossing = ((names[one], names[other]) for one, other in pairs)
        return [
            pair for pair in crossing if single.issuperset(pair) and not before[pair[0]] & before[pair[1]]
        ]

    def _joined_ends(self, crossing: Sequence[tuple[str, str]]) -> dict[tuple[str, int], str]:
        """Return the node of each end of each edge, (edge, 0) and (edge, -1): turns and crossings join ends."""
        over = {(edge, end): (edge, end) for edge in self.groups for end in (0, -1)}

        def top(end: tuple[str, int]) -> tuple[str, int]:
            while over[end] != end:
                end = over[end]
            return end

        end_before = {via: (self.lanes[source].edge, -1) for source, _, via in self.turns}
        joined = [((self.lanes[source].edge, -1), (self.lanes[to].edge, 0)) for source, to, _ in self.turns]
        for one, other in joined + [(end_before[one], end_before[other]) for one, other in crossing]:
            over[top(one)] = top(other)
        names: dict[tuple[str, int], str] = {}
        return {end: names.setdefault(top(end), f"node-{len(names)}") for end in over}

    def nodes(self) -> Element:
        """Return the nodes, each the hull of the ends of its lanes, dead ends without area."""
        corners: dict[str, list[Floats]] = {}
        for (edge, end), node in self.node_of.items():
            for name in self.groups[edge]:
                line = self.lines[name][:: 1 if end == 0 else -1]
                corners.setdefault(node, []).append(_mouth(line, self.widths[name]))
        counts = Counter(self.node_of.values())
        root = Element("nodes")
        for node, mouths in corners.items():
            x, y = np.mean([mouth[:2] for mouth in mouths], axis=(0, 1))
            element = SubElement(root, "node", id=node, x=f"{x:.3f}", y=f"{y:.3f}")
            if counts[node] > 1:
                outline = shapely.MultiPoint(np.concatenate(mouths)).convex_hull
                element.set("shape", _shape(np.array(outline.exterior.coords)[:-1]))
        return root

    def edges(self) -> Element:
        """Return the edges with their lanes."""
        root = Element("edges")
        for edge, group in self.groups.items():
            ends = {"from": self.node_of[edge, 0], "to": self.node_of[edge, -1]}
            element = SubElement(root, "edge", ends, id=edge, numLanes=str(len(group)))
            for index, name in enumerate(group):
                lane = SubElement(element, "lane", index=str(index), shape=_shape(self.lines[name]))
                lane.set("width", f"{self.widths[name]:.2f}")
                lane.set("speed", f"{self.by_id[name].speed:.3f}")
                if self.by_id[name].kind in _ALLOW:
                    lane.set("allow", _ALLOW[self.by_id[name].kind])
        return root

    def connections(self) -> Element:
        """Return the connections; those by way of a lanelet have its shape."""
        root = Element("connections")
        for source, target, via in self.turns:
            (edge, lane), (edge2, lane2) = self.lanes[source], self.lanes[target]
            ends = {"from": edge, "to": edge2, "fromLane": str(lane), "toLane": str(lane2)}
            connection = SubElement(root, "connection", ends)
            if via != target:
                # It begins and ends on the lanes that it joins.
                parts = (self.lines[source][-1:], self.lines[via][1:-1], self.lines[target][:1])
                connection.set("shape", _shape(np.vstack(parts)))
        return root


def _centreline(lanelet: Lanelet) -> Floats:
    """Return the mean of both bounds at equal shares of their lengths, at every vertex of either."""
    bounds = [without_repeats(lanelet.left), without_repeats(lanelet.right)]
    shares = [arc_lengths(bound) / arc_lengths(bound)[-1] for bound in bounds]
    at = np.unique(np.concatenate(shares).round(3))
    sides = [
        np.column_stack([np.interp(at, share, axis) for axis in bound.T])
        for bound, share in zip(bounds, shares, strict=True)
    ]
    return (sides[0] + sides[1]) / 2


def _width(lanelet: Lanelet) -> float:
    left, right = shapely.linestrings(lanelet.left), shapely.linestrings(lanelet.right)
    points = shapely.line_interpolate_point(left, np.linspace(0, 1, 11), normalized=True)
    return float(np.median(shapely.distance(points, right)))


def _mouth(line: Floats, width: float) -> Floats:
    """Return the corners of the first `NODE_DEPTH` of a lane [m], shape (4, 2)."""
    ahead = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
    across = np.array([-ahead[1], ahead[0]]) * width / 2
    return line[0] + np.array([across, -across, ahead * NODE_DEPTH - across, ahead * NODE_DEPTH + across])


def _shape(points: Floats) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)
