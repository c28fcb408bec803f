"""Import of a compiled SUMO network into a lane graph."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry import polylines
from smarts.roads.conflicts import LaneAreas, find_conflicts
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.permissions import lane_kind

POINT_SPACING = 1.0
"""The most that two points of a centreline are apart [m]."""
DEFAULT_LANE_WIDTH = 3.2
"""SUMO's default lane width [m]."""

DIRECTED = 0.1
"""A line shorter than this has no direction, since its points are rounded to 1 cm [m]."""


def write_driven_lengths(net: Path, roads: LaneGraph) -> int:
    """Write `LaneGraph.driven_length` into a network; return how many of its lanes had another length.

    Args:
        net: The file; only written if a lane has another length.
        roads: What has been read from it.
    """
    other = np.flatnonzero(roads.driven_length != roads.sumo_length).tolist()
    if other:
        tree = ElementTree.parse(net)
        lanes = [*tree.iterfind("edge/lane")]
        for lane in other:
            lanes[lane].set("length", f"{roads.driven_length[lane]:.10g}")
        tree.write(net, encoding="UTF-8", xml_declaration=True)
    return len(other)


@dataclass(frozen=True)
class _Edge:
    element: ElementTree.Element
    id: str
    function: str
    lanes: list[ElementTree.Element]


def read_net(net: Path) -> LaneGraph:
    """Return the lane graph of a compiled network."""
    return _NetReader(ElementTree.parse(net).getroot()).graph()


def read_responses(root: ElementTree.Element, graph: LaneGraph) -> list[tuple[int, int]]:
    """Return pairs (lane in a junction, lane on which others enter it): the first's drivers wait for theirs.

    By signs and rules, lights or not; at all-way stops and where traffic merges like a zip, both wait.

    Args:
        root: The network.
        graph: What has been read from it.
    """
    reader, found = _NetReader(root), []
    inside, start, before = graph.lane_junction, graph.predecessor_start, graph.predecessor
    for junction in reader.junctions:
        links, waits = reader.responses(junction, inside, start, before)
        for link, others in waits.items():
            found += [(lane, links[other][-1]) for lane in links[link] for other in others]
    return sorted(found)


class _NetReader:
    """The numbering of a network's objects, and the tables that follow from it."""

    def __init__(self, root: ElementTree.Element) -> None:
        self.root = root
        self.edges = [*map(_edge, root.iterfind("edge"))]
        self.lanes = [lane for edge in self.edges for lane in edge.lanes]
        self.lane_count = np.array([len(edge.lanes) for edge in self.edges], np.int32)
        self.lane_edge = np.repeat(np.arange(len(self.edges)), self.lane_count)
        self.first_lane = np.cumsum([0, *self.lane_count])[:-1]
        self.junctions = [j for j in root.iterfind("junction") if j.get("type") != "internal"]
        self.lane_number = _numbered(lane.attrib["id"] for lane in self.lanes)
        self.edge_number = _numbered(edge.id for edge in self.edges)
        self.junction_number = _numbered(junction.attrib["id"] for junction in self.junctions)

    def graph(self) -> LaneGraph:
        """Return the lane graph."""
        links, signal, signal_link, signal_ids = self._links()
        lines = self._centrelines(links)
        stations = [*map(polylines.arc_lengths, lines)]
        successor_start, successor = _csr(len(self.lanes), links)
        predecessor_start, predecessor = _csr(len(self.lanes), [(b, a) for a, b in links])
        width = _numbers(self.lanes, "width", DEFAULT_LANE_WIDTH)
        kind = np.array([*map(self._kind, range(len(self.lanes)))], np.int8)
        edge_junction = np.array([*map(self._junction_inside, self.edges)], np.int32)
        lane_junction = edge_junction[self.lane_edge]
        left, right = self._neighbours()
        inside = lane_junction >= 0
        conflicts = find_conflicts(
            LaneAreas(
                lines,
                width,
                lane_junction,
                kind,
                origin=_outside(inside, predecessor_start, predecessor),
                target=_outside(inside, successor_start, successor),
                gives_way=self._right_of_way(lane_junction, predecessor_start, predecessor),
            )
        )
        outlines = [*map(_outline, self.junctions)]
        return LaneGraph(
            lane_ids=tuple(self.lane_number),
            edge_ids=tuple(self.edge_number),
            junction_ids=tuple(self.junction_number),
            signal_ids=signal_ids,
            lane_edge=self.lane_edge.astype(np.int32),
            lane_index=_numbers(self.lanes, "index").astype(np.int32),
            lane_junction=lane_junction,
            length=np.array([s[-1] for s in stations]),
            sumo_length=_numbers(self.lanes, "length"),
            width=width,
            speed_limit=_numbers(self.lanes, "speed"),
            left=left,
            right=right,
            opposite=self._opposites(),
            is_internal=inside,
            kind=kind,
            signal=signal,
            signal_link=signal_link,
            point_start=_starts(lines),
            point_xy=np.concatenate(lines),
            point_z=np.concatenate([*map(_heights, self.lanes, stations)]),
            point_heading=np.concatenate([*map(polylines.headings, lines)]),
            point_s=np.concatenate(stations),
            successor_start=successor_start,
            successor=successor,
            predecessor_start=predecessor_start,
            predecessor=predecessor,
            **{f"conflict_{name}": column for name, column in vars(conflicts).items()},
            edge_first_lane=self.first_lane.astype(np.int32),
            edge_lane_count=self.lane_count,
            edge_is_internal=edge_junction >= 0,
            edge_is_roundabout=self._roundabouts(),
            edge_from=self._edge_ends("from"),
            edge_to=self._edge_ends("to"),
            junction_start=_starts(outlines),
            junction_xy=np.concatenate(outlines) if outlines else np.empty((0, 2)),
            junction_z=_numbers(self.junctions, "z", 0.0),
        )

    def _links(self) -> tuple[list[tuple[int, int]], Ints, Ints, tuple[str, ...]]:
        """Return lane-to-lane links, and for each lane the signal and the light that govern entering it."""
        links: set[tuple[int, int]] = set()
        signal = np.full(len(self.lanes), -1, np.int32)
        signal_link = np.full(len(self.lanes), -1, np.int32)
        signal_ids = dict.fromkeys(c.attrib["tl"] for c in self.root.iterfind("connection") if c.get("tl"))
        numbers = {name: number for number, name in enumerate(signal_ids)}
        for connection in self.root.iterfind("connection"):
            source = self._lane_at(connection.attrib["from"], connection.attrib["fromLane"])
            via = connection.get("via")
            if via is None:
                target = self._lane_at(connection.attrib["to"], connection.attrib["toLane"])
            else:
                target = self.lane_number[via]
            links.add((source, target))
            if connection.get("tl") and via is not None:
                signal[target] = numbers[connection.attrib["tl"]]
                signal_link[target] = int(connection.attrib["linkIndex"])
        return sorted(links), signal, signal_link, tuple(signal_ids)

    def _right_of_way(self, inside: Ints, start: Ints, before: Ints) -> dict[int, frozenset[int]]:
        """Return, for each lane in a junction, the lanes to whose traffic its own has to give way.

        A junction numbers its links in the order of `intLanes`. A link with a waiting point has two lanes in
        a row, of which the second one is listed. SUMO lets two links give way to each other at all-way stops,
        where traffic merges like a zip, and where lights decide; only at all-way stops that is a rule.

        Args:
            inside: Junction of each lane, -1 for road lanes.
            start: CSR of the lanes before each lane.
            before: See `start`.
        """
        found: dict[int, frozenset[int]] = {}
        for junction in self.junctions:
            links, waits = self.responses(junction, inside, start, before)
            all_stop = junction.get("type") == "allway_stop"
            for link, others in waits.items():
                first = [links[other] for other in others if all_stop or link not in waits.get(other, ())]
                for lane in links[link]:
                    found[lane] = frozenset(each for lanes in first for each in lanes)
        return found

    def responses(
        self, junction: ElementTree.Element, inside: Ints, start: Ints, before: Ints
    ) -> tuple[list[list[int]], dict[int, set[int]]]:
        """Return each link's lanes in a junction, the last one first, and the links that it gives way to."""
        links = [
            _with_first(self.lane_number[name], inside, start, before)
            for name in junction.get("intLanes", "").split()
        ]
        # The rightmost bit is that of link 0.
        waits = {
            int(request.attrib["index"]): {
                other for other, bit in enumerate(reversed(request.attrib["response"])) if bit == "1"
            }
            for request in junction.iterfind("request")
        }
        return links, waits if links else {}

    def _lane_at(self, edge: str, index: str) -> int:
        return int(self.first_lane[self.edge_number[edge]]) + int(index)

    def _centrelines(self, links: Sequence[tuple[int, int]]) -> list[Floats]:
        lines = [polylines.without_repeats(_points(lane.attrib["shape"])) for lane in self.lanes]
        before = {target: source for source, target in links}
        for number, line in enumerate(lines):
            if polylines.arc_lengths(line)[-1] < DIRECTED:
                lines[number] = _stub(line[0], lines[before[number]] if number in before else line)
        return [polylines.subdivide(line, POINT_SPACING) for line in lines]

    def _kind(self, lane: int) -> LaneKind:
        function = self.edges[self.lane_edge[lane]].function
        if function in ("crossing", "walkingarea"):
            return LaneKind.FOOT
        element = self.lanes[lane]
        return lane_kind(element.get("allow", ""), element.get("disallow", ""), element.get("type", ""))

    def _junction_inside(self, edge: _Edge) -> int:
        if edge.function == "normal":
            return -1
        # ":" junction "_" running number
        return self.junction_number[edge.id[1:].rsplit("_", 1)[0]]

    def _neighbours(self) -> tuple[Ints, Ints]:
        numbers = np.arange(len(self.lanes), dtype=np.int32)
        same_edge = self.lane_edge[1:] == self.lane_edge[:-1]
        left, right = np.full_like(numbers, -1), np.full_like(numbers, -1)
        left[:-1][same_edge] = numbers[1:][same_edge]
        right[1:][same_edge] = numbers[:-1][same_edge]
        return left, right

    def _opposites(self) -> Ints:
        opposite = np.full(len(self.lanes), -1, np.int32)
        for number, lane in enumerate(self.lanes):
            neighbour = lane.find("neigh")
            if neighbour is not None:
                opposite[number] = self.lane_number[neighbour.attrib["lane"]]
        return opposite

    def _roundabouts(self) -> Bools:
        ring = {edge for r in self.root.iterfind("roundabout") for edge in r.get("edges", "").split()}
        return np.array([edge.id in ring for edge in self.edges], np.bool_)

    def _edge_ends(self, end: str) -> Ints:
        return np.array(
            [self.junction_number.get(edge.element.get(end, ""), -1) for edge in self.edges], np.int32
        )


def _with_first(lane: int, inside: Ints, start: Ints, before: Ints) -> list[int]:
    """Return a lane inside a junction and those before it in the junction."""
    lanes = [lane]
    for each in lanes:
        earlier = before[start[each] : start[each + 1]]
        lanes += [int(one) for one in earlier if inside[one] >= 0 and int(one) not in lanes]
    return lanes


def _edge(element: ElementTree.Element) -> _Edge:
    return _Edge(
        element, element.attrib["id"], element.get("function", "normal"), list(element.iterfind("lane"))
    )


def _numbered(names: Iterable[str]) -> dict[str, int]:
    return {name: number for number, name in enumerate(names)}


def _numbers(elements: Iterable[ElementTree.Element], name: str, default: float | None = None) -> Floats:
    """Return an attribute of all elements; KeyError if one lacks it and there is no default."""
    texts = (e.attrib[name] if default is None else e.get(name, default) for e in elements)
    return np.array([float(text) for text in texts])


def _points(shape: str) -> Floats:
    return np.array([[float(value) for value in point.split(",")[:2]] for point in shape.split()])


def _heights(lane: ElementTree.Element, stations: Floats) -> Floats:
    """Return the heights of a lane at arc lengths in the plane [m]; points of two numbers are at height 0."""
    points = [point.split(",") for point in lane.attrib["shape"].split()]
    heights = [float(point[2]) if len(point) > 2 else 0.0 for point in points]
    if not any(heights):
        return np.zeros(len(stations))
    return np.interp(stations, polylines.arc_lengths(_points(lane.attrib["shape"])), heights)


def _stub(point: Floats, line_before: Floats) -> Floats:
    """Return a line of 1 mm at `point`: SUMO draws some lanes inside junctions with hardly any length."""
    step = line_before[-1] - line_before[-2] if len(line_before) > 1 else np.array([1.0, 0.0])
    direction = step / np.hypot(*step)
    return np.array([point - 0.0005 * direction, point + 0.0005 * direction])


def _outline(junction: ElementTree.Element) -> Floats:
    points = _points(junction.get("shape", "")).reshape(-1, 2)
    return points if len(points) >= 3 and junction.get("type") != "dead_end" else np.empty((0, 2))


def _starts(rows: Iterable[Sequence | Floats]) -> Ints:
    return np.cumsum([0] + [len(row) for row in rows]).astype(np.int32)


def _csr(count: int, pairs: Iterable[tuple[int, int]]) -> tuple[Ints, Ints]:
    """Return start and value arrays of the pairs (row, value), sorted by row and then by value."""
    table = np.array(sorted(pairs), np.int32).reshape(-1, 2)
    counts = np.bincount(table[:, 0], minlength=count)
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int32), table[:, 1].copy()


def _outside(inside: Bools, start: Ints, link: Ints) -> Ints:
    """Follow the links of each lane until they leave the junction; -1 where they end or fork inside it."""
    lanes = np.arange(len(inside), dtype=np.int32)
    single = np.diff(start) == 1
    onward = (
        np.where(single, link[np.minimum(start[:-1], len(link) - 1)], -1)
        if len(link)
        else np.full_like(lanes, -1)
    )
    for _ in range(int(inside.sum())):
        moving = (lanes >= 0) & inside[lanes]
        if not moving.any():
            break
        lanes = np.where(moving, onward[lanes], lanes).astype(np.int32)
    return lanes
