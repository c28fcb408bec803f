"""Maps of lanelets, which are lanes with a left and a right bound, as SUMO's plain XML for netconvert.

Lanes keep their centrelines, as the mean of their bounds, and get a constant width, the median distance of
the bounds. netconvert gives the junctions their lanes, right of way and outlines.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, ParseError, SubElement, tostring

import numpy as np
import shapely

from smarts.arrays import Floats
from smarts.errors import MapError
from smarts.geometry.polylines import arc_lengths, without_repeats
from smarts.registry import Registry
from smarts.roads.lane_graph import LaneKind

LANELET_MAPS = Registry(
    "map of lanelets",
    {
        "commonroad": "smarts.roads.lanelet_readers.commonroad:read",
        "lanelet2": "smarts.roads.lanelet_readers.lanelet2:read",
        "argoverse": "smarts.roads.lanelet_readers.argoverse:read",
        "waymo": "smarts.roads.lanelet_readers.waymo:read",
    },
)
"""Kind of a map's source -> its reader."""
NODE_DEPTH = 0.5
"""How far the outline of a node reaches into its lanes [m]. netconvert cuts lanes at the outline; those that
it draws itself swallow ramps."""
WIDEST_JUNCTION = 60.0
"""In maps that mark no junction, lanelets up to this length that cross are inside one [m]."""
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
    lights: tuple[str, ...] = ()
    """The traffic lights at its end."""
    assumes_limit: bool = False
    """Whether the map names no limit."""


def read_lanelets(kind: str, path: Path) -> list[Lanelet]:
    """Return the lanelets of a map of a kind in `LANELET_MAPS`.

    Raises:
        MapError: It is no such map, or broken.
    """
    try:
        if lanelets := LANELET_MAPS[kind](path):
            return lanelets
        problem = "it has no lanelets"
    except (ParseError, ValueError) as error:
        problem = str(error)
    except KeyError as error:
        problem = f"{error} is missing"
    raise MapError(
        f"not a map of kind {kind}: {problem}", place=str(path), remedy="give the whole, unchanged file"
    )


def plain_xml(lanelets: Sequence[Lanelet]) -> dict[str, str]:
    """Return the texts of SUMO's node, edge and connection files: "nod", "edg", "con".

    Neighbours make an edge, `road-A-B-C` from right to left. Those in a junction where lanelets cross become
    connections, so that their traffic conflicts.
    """
    network = _Network(lanelets)
    files = {"nod": network.nodes(), "edg": network.edges(), "con": network.connections()}
    return {part: tostring(root, "unicode") for part, root in files.items()}


class _Lane(NamedTuple):
    """The place of a lanelet in SUMO's network."""

    edge: str
    place: int
    """Place across the edge, 0 is the rightmost."""


class _Turn(NamedTuple):
    """A connection from a lanelet to another."""

    source: str
    inside: tuple[str, ...]
    """The lanelets inside the junction that it is drawn as."""
    target: str
    is_lit: bool
    """Whether it has a traffic light."""


class _Network:
    """SUMO's network of a map of lanelets."""

    def __init__(self, lanelets: Sequence[Lanelet]) -> None:
        self.by_id = {each.id: each for each in lanelets}
        self.lines = {each.id: _centreline(each) for each in lanelets}
        self.widths = {each.id: _width(each) for each in lanelets}
        self.before: dict[str, set[str]] = {each.id: set() for each in lanelets}
        for each in lanelets:
            for target in each.successors:
                self.before[target].add(each.id)
        self.inside: set[str] = set()
        """Lanelets that become connections."""
        roads = self._roads()
        found = self._crossing()
        while True:
            # Where one lanelet of a road is inside a junction, all are.
            self.inside |= {name for road in roads if not found.isdisjoint(road) for name in road}
            self._connect([road for road in roads if self.inside.isdisjoint(road)])
            if not (found := self._swallowed()):
                break

    def _roads(self) -> list[list[str]]:
        """Return the lanelets that lie side by side, each time from right to left."""
        beside = {each.left_neighbour for each in self.by_id.values()}
        roads = [[name] for name in self.by_id if name not in beside]
        for road in roads:
            while self.by_id[road[-1]].left_neighbour:
                road.append(self.by_id[road[-1]].left_neighbour)
        return roads

    def _is_between(self, name: str) -> bool:
        return bool(self.before[name] and self.by_id[name].successors)

    def _crossing(self) -> set[str]:
        """Return the lanelets that cross another one in a junction.

        Both come from elsewhere, and are, or follow, what the map calls part of a junction, or are short if
        it names none: bridges cross roads as well. To be called so is not enough: ramps are, too.
        """
        called = {name for name, each in self.by_id.items() if each.inside}
        if not called:
            called = {name for name, line in self.lines.items() if arc_lengths(line)[-1] < WIDEST_JUNCTION}
        names = [
            name for name in self.by_id if called & {name, *self.before[name]} and self._is_between(name)
        ]
        pairs = ((names[one], names[other]) for one, other in self._cross(names))
        return {one for one, other in pairs if not self.before[one] & self.before[other]}

    def _cross(self, names: Sequence[str]) -> list[tuple[int, int]]:
        """Return the pairs of lanelets whose centrelines cross, by their place among `names`."""
        shapes = np.array([shapely.LineString(self.lines[name]) for name in names], object)
        return shapely.STRtree(shapes).query(shapes, predicate="crosses").T.tolist()

    def _connect(self, roads: Sequence[list[str]]) -> None:
        """Make edges of roads, and connect them."""
        self.groups = {f"road-{'-'.join(road)}": road for road in roads}
        self.lanes = {
            name: _Lane(edge, k) for edge, road in self.groups.items() for k, name in enumerate(road)
        }
        self.turns = [
            _Turn(name, *way, is_lit=any(self.by_id[each].lights for each in (name, *way[0])))
            for name in self.lanes
            for way in self._ways(name)
        ]
        self.node_of = self._joined_ends()
        mouths: dict[str, list[Floats]] = {}
        for (edge, end), node in self.node_of.items():
            for name in self.groups[edge]:
                line = self.lines[name][:: 1 if end == 0 else -1]
                mouths.setdefault(node, []).append(_mouth(line, self.widths[name]))
        self.outlines = {
            node: shapely.MultiPoint(np.concatenate(each)).convex_hull for node, each in mouths.items()
        }

    def _ways(self, name: str, inside: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
        """Yield the lanelets inside a junction on each way from a lanelet, and the one that it leads to."""
        for after in self.by_id[name].successors:
            if after not in self.inside:
                yield inside, after
            elif after not in inside:
                yield from self._ways(after, (*inside, after))

    def _joined_ends(self) -> dict[tuple[str, int], str]:
        """Return the node of each end of each edge, (edge, 0) and (edge, -1).

        Ends that a turn joins share a node, as do those of turns whose lanelets cross.
        """
        over = {(edge, end): (edge, end) for edge in self.groups for end in (0, -1)}

        def top(end: tuple[str, int]) -> tuple[str, int]:
            while over[end] != end:
                end = over[end]
            return end

        begin = {name: (lane.edge, 0) for name, lane in self.lanes.items()}
        end = {name: (lane.edge, -1) for name, lane in self.lanes.items()}
        steps = [(turn.source, step) for turn in self.turns for step in turn.inside]
        joined = [(end[turn.source], begin[turn.target]) for turn in self.turns]
        for one, other in self._cross([step for _, step in steps]):
            joined.append((end[steps[one][0]], end[steps[other][0]]))
        for one, other in joined:
            over[top(one)] = top(other)
        names: dict[tuple[str, int], str] = {}
        return {each: names.setdefault(top(each), f"node-{len(names)}") for each in over}

    def _swallowed(self) -> set[str]:
        """Return the lanelets that lie for the most part in a junction that they are joined to."""
        return {
            name
            for (edge, _), node in self.node_of.items()
            for name in filter(self._is_between, self.groups[edge])
            if (line := shapely.LineString(self.lines[name])).intersection(self.outlines[node]).length
            > line.length / 2
        }

    def nodes(self) -> Element:
        """Return the nodes; dead ends have no area, so that their roads are as long as the lanelets."""
        root = Element("nodes")
        counts = Counter(self.node_of.values())
        places = {node: self.lines[self.groups[edge][0]][end] for (edge, end), node in self.node_of.items()}
        lit = {self.node_of[self.lanes[turn.source].edge, -1] for turn in self.turns if turn.is_lit}
        for node, (x, y) in places.items():
            element = SubElement(root, "node", id=node, x=f"{x:.3f}", y=f"{y:.3f}")
            if node in lit:
                element.set("type", "traffic_light")
            if counts[node] > 1:
                element.set("shape", _shape(shapely.get_coordinates(self.outlines[node])[:-1]))
        return root

    def edges(self) -> Element:
        """Return the edges with their lanes."""
        root = Element("edges")
        for edge, group in self.groups.items():
            ends = {"from": self.node_of[edge, 0], "to": self.node_of[edge, -1]}
            element = SubElement(root, "edge", ends, id=edge, numLanes=str(len(group)))
            for index, name in enumerate(group):
                lanelet = self.by_id[name]
                lane = SubElement(element, "lane", index=str(index), shape=_shape(self.lines[name]))
                lane.attrib.update(width=f"{self.widths[name]:.2f}", speed=f"{lanelet.speed:.3f}")
                if lanelet.kind in _ALLOW:
                    lane.set("allow", _ALLOW[lanelet.kind])
        return root

    def connections(self) -> Element:
        """Return the connections, which have the shape of all that lies in the outline of their node."""
        root = Element("connections")
        for source, inside, target, is_lit in self.turns:
            (edge, lane), (edge2, lane2) = self.lanes[source], self.lanes[target]
            outline = self.outlines[self.node_of[edge, -1]]
            parts = [
                _part_in(outline, self.lines[source], -1),
                *(self.lines[name] for name in inside),
                _part_in(outline, self.lines[target], 0),
            ]
            ends = {"from": edge, "to": edge2, "fromLane": str(lane), "toLane": str(lane2)}
            ends["uncontrolled"] = str(not is_lit).lower()
            SubElement(root, "connection", ends, shape=_shape(without_repeats(np.vstack(parts))))
        return root


def _part_in(outline: shapely.Geometry, line: Floats, which: int) -> Floats:
    """Return the first (0) or last (-1) part of a line that lies in an outline."""
    parts = shapely.get_parts(shapely.LineString(line).intersection(outline))
    return shapely.get_coordinates(parts[which]) if len(parts) else line[[which]]


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
