"""A lane graph as a message `map`: what of it is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.roads.lane_graph import OPPOSITE, LaneGraph, LaneKind, Yields
from smarts.stream.arrays import packed_array, packed_runs
from smarts.stream.motion import PER_METRE

NO_LINE, DASHED, EDGE, CENTRE = range(4)
"""What is painted at a lane's side: nothing, dashed white, solid white, solid yellow towards the other
direction."""
NO_STOP, AT_LIGHTS, GIVES_WAY = range(3)
"""Why there is a stop line at a lane's end."""
_TOLERANCE = 0.012
"""Tolerance of the simplified centrelines [m]; with the rounding to 1 cm they are less than 2 cm off."""
_BESIDE = 1.0
"""The nearest lane of the other direction is beside if no more than this is between the two [m]."""


def origin_of(graph: LaneGraph) -> tuple[float, float]:
    """Return the point that positions are relative to: the map's lower left corner in whole metres."""
    x, y = np.floor(graph.point_xy.min(0)).tolist()
    return x, y


def map_message(graph: LaneGraph, digest: str) -> dict[str, Any]:
    """Return the message of a map."""
    origin = np.array(origin_of(graph))
    lines = [_simplified(graph.centreline(lane) - origin) for lane in range(len(graph.lane_ids))]
    points = np.concatenate(lines)
    left, right = _markings(graph)
    first = np.concatenate([np.arange(len(line)) == 0 for line in lines])
    columns = {
        "start": np.cumsum([0, *map(len, lines)]).astype(np.uint32),
        "width": np.rint(graph.width * PER_METRE).astype(np.uint16),
        "kind": graph.kind.astype(np.uint8),
        "junction": graph.is_internal.astype(np.uint8),
        "left": left,
        "right": right,
        "stop": _stops(graph),
        "signal": (graph.signal >= 0).astype(np.uint8),
        "speed_limit": graph.speed_limit.astype(np.float32),
        "edge": graph.lane_edge.astype(np.uint32),
    }
    low, high = graph.point_xy.min(0) - origin, graph.point_xy.max(0) - origin
    return {
        "type": "map",
        "digest": digest,
        "bounds": [*low.tolist(), *high.tolist()],
        "lanes": {name: packed_array(column) for name, column in columns.items()}
        | {name: packed_runs(points[:, axis], first) for axis, name in enumerate("xy")},
        "edges": list(graph.edge_ids),
    }


def _simplified(line: Floats) -> NDArray[np.int32]:
    """Return the points of a line [cm] that are needed."""
    kept = shapely.get_coordinates(shapely.simplify(shapely.LineString(line), _TOLERANCE))
    return np.rint(kept * PER_METRE).astype(np.int32)


def _markings(graph: LaneGraph) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the lines painted to the left and to the right of each lane, shape (L,) each."""
    is_road = is_roadway(graph)
    is_painted = is_road & ~graph.is_internal

    def painted(neighbour: NDArray) -> NDArray[np.uint8]:
        continues = (neighbour >= 0) & is_road[neighbour]
        return np.where(is_painted, np.where(continues, DASHED, EDGE), NO_LINE).astype(np.uint8)

    left, right = painted(graph.left), painted(graph.right)
    left[(left == EDGE) & _is_beside_opposite(graph)] = CENTRE
    return left, right


def _is_beside_opposite(graph: LaneGraph) -> Bools:
    """Return which lanes have one of the other direction to their left, shape (L,)."""
    lanes = np.arange(len(graph.lane_ids))
    leftmost = graph.edge_first_lane + graph.edge_lane_count - 1
    ends = zip(graph.edge_from.tolist(), graph.edge_to.tolist(), leftmost.tolist(), strict=True)
    towards: dict[tuple[int, int], list[int]] = {}
    for begin, end, lane in ends:
        towards.setdefault((begin, end), []).append(lane)
    found = graph.opposite >= 0
    for lane in lanes[(graph.left < 0) & ~graph.is_internal].tolist():
        edge = int(graph.lane_edge[lane])
        for other in towards.get((int(graph.edge_to[edge]), int(graph.edge_from[edge])), ()):
            found[lane] |= _is_beside(graph, lane, other)
    return found


def _is_beside(graph: LaneGraph, lane: int, other: int) -> bool:
    """Return whether two lanes touch at the middle of the first, and lead in opposite directions there."""
    # Of a centreline with two points, the middle is its end.
    middle = int(graph.point_start[lane] + graph.point_start[lane + 1]) // 2
    off = graph.centreline(other) - graph.point_xy[middle]
    nearest = int(np.argmin(np.hypot(off[:, 0], off[:, 1])))
    gap = np.hypot(*off[nearest]) - (graph.width[lane] + graph.width[other]) / 2
    turn = graph.point_heading[graph.point_start[other] + nearest] - graph.point_heading[middle]
    return bool(gap < _BESIDE and np.cos(turn) < OPPOSITE)


def _stops(graph: LaneGraph) -> NDArray[np.uint8]:
    """Return why there is a stop line at the end of each lane, shape (L,).

    A lane that also leads on without giving way, as one for straight on and left, has none.
    """
    lanes = np.arange(len(graph.lane_ids))
    of_conflict = np.repeat(lanes, np.diff(graph.conflict_start))
    is_met = (
        np.isin(graph.conflict_yields, (Yields.THIS, Yields.BOTH)) & is_roadway(graph)[graph.conflict_lane]
    )
    gives_way = np.zeros(len(lanes), np.bool_)
    gives_way[of_conflict[is_met]] = True
    before = np.repeat(lanes, np.diff(graph.successor_start))
    lead_on = np.bincount(before, ~gives_way[graph.successor], len(lanes)) > 0
    stops = np.where((np.diff(graph.successor_start) > 0) & ~lead_on, GIVES_WAY, NO_STOP).astype(np.uint8)
    stops[before[(graph.signal >= 0)[graph.successor]]] = AT_LIGHTS
    stops[graph.is_internal | ~is_roadway(graph)] = NO_STOP
    return stops


def is_roadway(graph: LaneGraph) -> Bools:
    """Return which lanes cars or buses drive on, shape (L,)."""
    return np.isin(graph.kind, (LaneKind.CAR, LaneKind.BUS))
