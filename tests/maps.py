"""Hand-made road maps without SUMO, with coordinates that can be worked out by hand."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import shapely

from smarts.roads.conflicts import LaneAreas, find_conflicts
from smarts.roads.lane_graph import LaneGraph, LaneKind

Point = tuple[float, float]
Link = tuple[tuple[str, int], tuple[str, int]]
"""A connection across the junction, from lane (edge, index) to lane (edge, index)."""
Turn = tuple[str, str]
"""A way across the junction of `crossing`, from arm to arm."""


@dataclass(frozen=True)
class Road:
    """An edge, given by the centreline of its rightmost lane [m] and the number of lanes."""

    points: Sequence[Point]
    lanes: int = 1
    width: float = 3.2
    speed: float = 14.0
    kind: LaneKind = LaneKind.CAR


@dataclass
class _Lane:
    name: str
    edge: int
    index: int
    points: np.ndarray
    width: float
    speed: float
    kind: LaneKind
    inside: bool = False

    @property
    def stations(self) -> np.ndarray:
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))))

    @property
    def headings(self) -> np.ndarray:
        tangent = np.gradient(self.points, axis=0)
        return np.arctan2(tangent[:, 1], tangent[:, 0])


def straight(lanes: int = 3, length: float = 200.0) -> LaneGraph:
    """Return a map with edge "road" along +x from the origin; lane i is centred at y = 3.2 i."""
    return graph_of({"road": Road([(0.0, 0.0), (length, 0.0)], lanes)})


def bend(lanes: int = 2, radius: float = 30.0) -> LaneGraph:
    """Return a map with edge "bend", a left quarter circle around (0, 0) from (radius, 0) to (0, radius).

    The rightmost lane has the radius given, lane i has radius - 3.2 i.
    """
    angles = np.linspace(0.0, math.pi / 2, 1 + math.ceil(radius * math.pi * 2))
    return graph_of({"bend": Road([(radius * math.cos(a), radius * math.sin(a)) for a in angles], lanes)})


def crossing(
    length: float = 80.0,
    gap: float = 10.0,
    gives_way: Mapping[Turn, Sequence[Turn]] = MappingProxyType({}),
    widths: Mapping[str, float] = MappingProxyType({}),
) -> LaneGraph:
    """Return a crossing of four arms with one lane per direction, 1.6 m off the axes, without U-turns.

    Arms are named by their position: "west_in" leads from the west to the junction at the origin, "east_out"
    leads away to the east. The junction begins `gap` metres from the origin. Lanes are 3.2 m wide but for
    those of the arms in `widths`; ways across the junction are as wide as the lanes that they come from.
    """
    directions = {"west": (-1, 0), "south": (0, -1), "east": (1, 0), "north": (0, 1)}
    roads: dict[str, Road] = {}
    for arm, (x, y) in directions.items():
        # To the right of the outward direction.
        aside = np.array([y, -x]) * 1.6
        near, far = np.array([x, y]) * gap, np.array([x, y]) * (gap + length)
        width = widths.get(arm, 3.2)
        roads[f"{arm}_out"] = Road([tuple(near + aside), tuple(far + aside)], width=width)
        roads[f"{arm}_in"] = Road([tuple(far - aside), tuple(near - aside)], width=width)
    links = [
        ((f"{begin}_in", 0), (f"{end}_out", 0)) for begin in directions for end in directions if begin != end
    ]
    turns = [(begin, end) for begin in directions for end in directions if begin != end]
    rules = {turns.index(turn): [*map(turns.index, first)] for turn, first in gives_way.items()}
    return graph_of(roads, links, rules)


def bridge(height: float = 8.0) -> LaneGraph:
    """Return edge "below" along +x, and edge "above" along +y, `height` metres over it at the origin."""
    ways = {"below": Road([(-100.0, 0.0), (100.0, 0.0)]), "above": Road([(0.0, -100.0), (0.0, 100.0)])}
    graph = graph_of(ways)
    return replace(graph, point_z=np.repeat([0.0, height], np.diff(graph.point_start)))


def ramp(top: float = 12.0) -> LaneGraph:
    """Return edge "ramp": east along y = 0, round a loop to the left, and south across itself at x = 60.

    It climbs evenly to `top` metres: it crosses itself after 60 m, and after 328.5 of 428.5 m.
    """
    turns = np.linspace(-0.5 * math.pi, math.pi, 400)
    loop = [(100.0 + 40.0 * math.cos(a), 40.0 + 40.0 * math.sin(a)) for a in turns]
    graph = graph_of({"ramp": Road([(0.0, 0.0), *loop, (60.0, -100.0)])})
    return replace(graph, point_z=top * graph.point_s / graph.length[0])


def graph_of(
    roads: Mapping[str, Road],
    links: Sequence[Link] = (),
    gives_way: Mapping[int, Sequence[int]] = MappingProxyType({}),
) -> LaneGraph:
    """Return the graph of some roads and of the connections across the junction between them.

    `gives_way` lists, for connections by number, the connections that go first.
    """
    lanes = [
        lane for number, (name, road) in enumerate(roads.items()) for lane in _lanes_of(name, number, road)
    ]
    place = {lane.name: number for number, lane in enumerate(lanes)}
    following: list[list[int]] = [[] for _ in range(len(lanes) + len(links))]
    for number, ((begin, begin_index), (end, end_index)) in enumerate(links):
        before, after = place[f"{begin}_{begin_index}"], place[f"{end}_{end_index}"]
        way = _connection(lanes[before], lanes[after])
        name = f":junction_{number}_0"
        edge, width = len(roads) + number, lanes[before].width
        lanes.append(_Lane(name, edge, 0, way, width, 10.0, LaneKind.CAR, inside=True))
        following[before].append(len(lanes) - 1)
        following[len(lanes) - 1].append(after)
    first = len(lanes) - len(links)
    rules = {first + link: frozenset(first + other for other in others) for link, others in gives_way.items()}
    return _graph(roads, lanes, following, rules)


def _lanes_of(name: str, edge: int, road: Road) -> list[_Lane]:
    line = _resample(np.array(road.points, float))
    tangent = np.gradient(line, axis=0)
    left = np.stack([-tangent[:, 1], tangent[:, 0]], -1) / np.linalg.norm(tangent, axis=1)[:, None]
    return [
        _Lane(
            f"{name}_{index}",
            edge,
            index,
            line + index * road.width * left,
            road.width,
            road.speed,
            road.kind,
        )
        for index in range(road.lanes)
    ]


def _resample(line: np.ndarray) -> np.ndarray:
    """Return the line with points at most 1 m apart."""
    parts = [line[:1]]
    for begin, end in itertools.pairwise(line):
        pieces = max(1, math.ceil(np.linalg.norm(end - begin)))
        parts.append(begin + (end - begin) * (np.arange(1, pieces + 1) / pieces)[:, None])
    return np.concatenate(parts)


def _connection(before: _Lane, after: _Lane) -> np.ndarray:
    """Return a cubic from the end of one lane to the beginning of another, with continuous headings."""
    begin, end = before.points[-1], after.points[0]
    reach = np.linalg.norm(end - begin)
    out = reach * np.array([math.cos(before.headings[-1]), math.sin(before.headings[-1])])
    into = reach * np.array([math.cos(after.headings[0]), math.sin(after.headings[0])])
    u = np.linspace(0.0, 1.0, 50)[:, None]
    curve = (2 * u**3 - 3 * u**2 + 1) * begin + (u**3 - 2 * u**2 + u) * out
    return _resample(curve + (3 * u**2 - 2 * u**3) * end + (u**3 - u**2) * into)


def _graph(
    roads: Mapping[str, Road],
    lanes: Sequence[_Lane],
    following: Sequence[Sequence[int]],
    gives_way: Mapping[int, frozenset[int]],
) -> LaneGraph:
    count = len(lanes)
    inside = np.array([lane.inside for lane in lanes])
    edges = np.array([lane.edge for lane in lanes], np.int32)
    index = np.array([lane.index for lane in lanes], np.int32)
    number_of_edges = int(edges.max()) + 1
    lanes_of_edge = np.bincount(edges, minlength=number_of_edges).astype(np.int32)
    first_lane = np.array(
        [int(np.flatnonzero(edges == edge)[0]) for edge in range(number_of_edges)], np.int32
    )
    numbers = np.arange(count, dtype=np.int32)
    length = np.array([lane.stations[-1] for lane in lanes])
    leading = [[n for n in range(count) if lane in following[n]] for lane in range(count)]
    nowhere = np.full(count, -1, np.int32)
    conflicts = find_conflicts(
        LaneAreas(
            [lane.points for lane in lanes],
            np.array([lane.width for lane in lanes]),
            np.where(inside, 0, -1).astype(np.int32),
            np.array([lane.kind for lane in lanes], np.int8),
            origin=_only(leading),
            target=_only(following),
            gives_way=gives_way,
        )
    )
    outline = _outline([lane for lane in lanes if lane.inside])
    internal_edge = np.arange(number_of_edges) >= len(roads)
    names = [*roads, *(f":junction_{number}" for number in range(number_of_edges - len(roads)))]
    return LaneGraph(
        lane_ids=tuple(lane.name for lane in lanes),
        edge_ids=tuple(names),
        junction_ids=("junction",),
        signal_ids=(),
        lane_edge=edges,
        lane_index=index,
        lane_junction=np.where(inside, 0, -1).astype(np.int32),
        length=length,
        sumo_length=length.copy(),
        width=np.array([lane.width for lane in lanes]),
        speed_limit=np.array([lane.speed for lane in lanes]),
        left=np.where(index + 1 < lanes_of_edge[edges], numbers + 1, -1).astype(np.int32),
        right=np.where(index > 0, numbers - 1, -1).astype(np.int32),
        opposite=nowhere.copy(),
        is_internal=inside,
        kind=np.array([lane.kind for lane in lanes], np.int8),
        signal=nowhere.copy(),
        signal_link=nowhere.copy(),
        point_start=_starts([len(lane.points) for lane in lanes]),
        point_xy=np.concatenate([lane.points for lane in lanes]),
        point_z=np.zeros(sum(len(lane.points) for lane in lanes)),
        point_heading=np.concatenate([lane.headings for lane in lanes]),
        point_s=np.concatenate([lane.stations for lane in lanes]),
        successor_start=_starts([len(after) for after in following]),
        successor=np.array([lane for after in following for lane in after], np.int32),
        predecessor_start=_starts([len(before) for before in leading]),
        predecessor=np.array([lane for before in leading for lane in before], np.int32),
        conflict_start=conflicts.start,
        conflict_lane=conflicts.lane,
        conflict_kind=conflicts.kind,
        conflict_yields=conflicts.yields,
        conflict_extent=conflicts.extent,
        conflict_other_extent=conflicts.other_extent,
        edge_first_lane=first_lane,
        edge_lane_count=lanes_of_edge,
        edge_is_internal=internal_edge,
        edge_is_roundabout=np.zeros(number_of_edges, np.bool_),
        edge_from=np.where(internal_edge, -1, 0).astype(np.int32),
        edge_to=np.where(internal_edge, -1, 0).astype(np.int32),
        junction_start=np.array([0, len(outline)], np.int32),
        junction_xy=outline,
        junction_z=np.zeros(1),
    )


def _only(lanes: Sequence[Sequence[int]]) -> np.ndarray:
    """Return the lane of each list with one lane, -1 for the other lists."""
    return np.array([each[0] if len(each) == 1 else -1 for each in lanes], np.int32)


def _starts(counts: Sequence[int]) -> np.ndarray:
    return np.cumsum([0, *counts]).astype(np.int32)


def _outline(lanes: Sequence[_Lane]) -> np.ndarray:
    """Return the convex hull of the lanes' areas [m], shape (V, 2); empty without lanes."""
    if not lanes:
        return np.zeros((0, 2))
    areas = [shapely.LineString(lane.points).buffer(lane.width / 2, cap_style="flat") for lane in lanes]
    return np.array(shapely.union_all(areas).convex_hull.exterior.coords)[:-1]
