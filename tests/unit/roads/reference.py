"""The kernels' rules written plainly in NumPy over all lanes at once, one pose at a time."""

import numpy as np

from smarts.roads.corridors import route_corridor
from smarts.roads.kernels import END_TOLERANCE, HEADING_COST, OFF_ROUTE_COST
from smarts.roads.lane_graph import LaneKind

ROAD = (LaneKind.CAR, LaneKind.BUS)


class Segments:
    """All segments of a graph's centrelines as arrays."""

    def __init__(self, graph):
        self.graph = graph
        last = graph.point_start[1:] - 1
        self.first = np.setdiff1d(np.arange(len(graph.point_s)), last)
        self.lane = np.repeat(np.arange(len(graph.length)), np.diff(graph.point_start))[self.first]
        self.begin, self.end = graph.point_xy[self.first], graph.point_xy[self.first + 1]
        self.is_begin = np.isin(self.first, graph.point_start[:-1])
        self.is_end = np.isin(self.first + 1, last)

    def feet(self, x, y):
        """Return for each lane distance, s, t, overshoot and the heading of its centreline at the foot."""
        graph = self.graph
        direction = self.end - self.begin
        length = np.hypot(*direction.T)
        offset = np.array([x, y]) - self.begin
        share = (offset * direction).sum(1) / length**2
        clipped = np.clip(share, 0, 1)
        distance = np.hypot(*(offset - clipped[:, None] * direction).T)
        lateral = (direction[:, 0] * offset[:, 1] - direction[:, 1] * offset[:, 0]) / length
        order = np.lexsort((np.arange(len(distance)), distance, self.lane))
        best = order[np.unique(self.lane[order], return_index=True)[1]]
        overshoot = (
            np.maximum(np.where(self.is_begin, -share, 0), np.where(self.is_end, share - 1, 0)).clip(0)
            * length
        )
        s = graph.point_s[self.first] + clipped * np.diff(graph.point_s)[self.first]
        t = np.where(overshoot > 0, lateral, np.copysign(distance, lateral))
        before, after = graph.point_heading[self.first], graph.point_heading[self.first + 1]
        turn = np.angle(np.exp(1j * (after - before)))
        heading = before + clipped * turn
        return distance[best], s[best], t[best], overshoot[best], heading[best]


def locate(segments, x, y, heading=None, route=None, kinds=ROAD):
    """Return lane, s, t, distance and cost of the place, and the least cost of another lane."""
    graph = segments.graph
    distance, s, t, overshoot, direction = segments.feet(x, y)
    counted = np.isin(graph.kind, kinds)
    reach = graph.width / 2 * np.where(graph.is_internal, 2, 1)
    near = counted & (distance <= reach) & (overshoot <= END_TOLERANCE)
    if (near & ~graph.is_internal).any():
        near &= distance <= graph.width / 2
    cost = np.where(near if near.any() else counted, distance, np.inf)
    if near.any() and heading is not None:
        cost = cost + HEADING_COST * (1 - np.cos(heading - direction)) / 2
    if near.any() and route is not None:
        on_route = np.isin(np.arange(len(cost)), route_corridor(graph, route, frozenset(kinds)).lane)
        cost = cost + np.where(on_route, 0, OFF_ROUTE_COST)
    best, second = np.argsort(cost)[:2]
    return best, s[best], t[best], distance[best], cost[best], cost[second]


def waypoints(segments, lane, x, y, route=None, leg=None, lookahead=32, spacing=1.0):
    """Return the paths of a vehicle, each a list of (lane, s), following `WaypointPaths`.

    `leg` is the number of the route's edge that the vehicle is on, or has just left if inside a junction.
    """
    graph = segments.graph
    usable = np.isin(graph.kind, ROAD)
    feet = segments.feet(x, y)[1]
    if route is None:
        lanes = [other for other in graph.edge_lanes(int(graph.lane_edge[lane])) if usable[other]]
        starts = [(other, feet[other], None) for other in lanes]
    elif graph.is_internal[lane]:
        starts = _junction_starts(graph, route, leg, feet)
    else:
        lanes = [other for other in graph.edge_lanes(int(graph.lane_edge[lane])) if usable[other]]
        starts = [(other, feet[other], leg) for other in lanes]
    return [path for start in starts for path in _paths(graph, usable, route, *start, lookahead, spacing)]


def _junction_starts(graph, route, leg, feet):
    corridor = route_corridor(graph, route, frozenset(ROAD))
    starts = []
    for row in np.flatnonzero(corridor.group == 2 * leg + 1):
        lane = int(corridor.lane[row])
        onward = [int(other) for other in graph.successors(lane) if graph.is_internal[other]]
        second = any(graph.is_internal[other] for other in graph.predecessors(lane))
        if any(feet[other] > 0 for other in onward) or (second and feet[lane] == 0):
            continue
        starts.append((lane, feet[lane], leg))
    return starts


def _leads_to(graph, lane, edge):
    while graph.is_internal[lane]:
        lane = int(graph.successors(lane)[0])
    return graph.lane_edge[lane] == edge


def _paths(graph, usable, route, lane, s, leg, lookahead, spacing):
    points = []
    while len(points) < lookahead and s <= graph.length[lane]:
        points.append((lane, s))
        s += spacing
    if len(points) == lookahead:
        return [points]
    following = [int(other) for other in graph.successors(lane) if usable[other]]
    if leg is not None and not graph.is_internal[lane]:
        ahead = graph.edge_number(route[leg + 1]) if leg + 1 < len(route) else -1
        following = [other for other in following if _leads_to(graph, other, ahead)]
    paths = []
    for other in following:
        next_leg = leg
        if leg is not None and not graph.is_internal[other]:
            next_leg = leg + 1
        rest = lookahead - len(points)
        paths += [
            points + path
            for path in _paths(graph, usable, route, other, s - graph.length[lane], next_leg, rest, spacing)
        ]
    return paths or [points]
