"""An atlas for tests whose queries take E poses and return new arrays."""

from __future__ import annotations

import numpy as np

from smarts.geometry.binding import bind
from smarts.roads import footprints, kernels
from smarts.roads.atlas import ROAD_LANES, NearestLanes, RoadAtlas
from smarts.roads.waypoints import WaypointPaths, write_waypoints


class RoadQueries(RoadAtlas):
    """A `RoadAtlas` with a method for each kernel over poses; arguments may be lists or have other dtypes."""

    def locate(self, maps, position, heading=None, routes=None, table=None, *, height=None, kinds=ROAD_LANES):
        found = NearestLanes.allocate(len(maps))
        heading = np.full(len(maps), np.nan) if heading is None else _floats(heading)
        routes = np.full(len(maps), -1, np.int32) if routes is None else _ints(routes)
        ask = bind(kernels.locate, self.roads, self.no_routes if table is None else table)
        height = np.full(len(maps), np.nan) if height is None else _floats(height)
        ask(_ints(maps), _floats(position), height, heading, routes, _mask(kinds), *found)
        return found

    def project(self, maps, lane, position):
        s, t = np.empty(len(maps)), np.empty(len(maps))
        places = _ints(maps), _ints(lane), _floats(position), np.full(len(maps), np.nan)
        bind(kernels.project_on_lanes, self.roads)(*places, s, t)
        return s, t

    def poses(self, maps, lane, s, t):
        position, heading = np.empty((len(maps), 2)), np.empty(len(maps))
        ask = bind(kernels.poses_at, self.roads)
        ask(_ints(maps), _ints(lane), _floats(s), _floats(t), position, heading)
        return position, heading

    def on_road(self, maps, position, *, height=np.nan, kinds=ROAD_LANES, junctions=True):
        ask, mask = bind(footprints.is_on_road, self.roads), _mask(kinds)
        places = zip(maps, np.asarray(position).tolist(), strict=True)
        return np.array([ask(int(m), x, y, height, mask, junctions) for m, (x, y) in places], np.bool_)

    def corners_on_road(self, maps, position, heading, length, width):
        ask, mask = bind(footprints.count_corners_on_road, self.roads), _mask(ROAD_LANES)
        rows = np.column_stack([position, np.zeros(len(maps)), heading, length, width]).tolist()
        return np.array([ask(int(m), *row, mask, True) for m, row in zip(maps, rows, strict=True)])

    def route_distances(self, table, maps, routes, lane, s, hint=None):
        find, measure = bind(kernels.find_row, table), bind(kernels.distance_on_row, self.roads, table)
        done, remaining = np.full(len(maps), np.nan), np.full(len(maps), np.nan)
        for i, hinted in enumerate([np.nan] * len(maps) if hint is None else hint):
            if lane[i] < 0 or routes[i] < 0:
                continue
            corridor = table.free + int(routes[i])
            row = find(corridor, int(self.roads.lane_base[maps[i]] + lane[i]), float(hinted))
            if row >= 0:
                done[i] = measure(row, float(s[i]))
                remaining[i] = table.end[table.start[corridor + 1] - 1] - done[i]
        return done, remaining

    def waypoints(self, table, m, xy, lane, route=-1, hint=np.nan, *, paths=8, lookahead=32, spacing=1.0):
        """Return a vehicle's paths, rows as in `WaypointPaths.point`, and how many were left out."""
        found, mask = WaypointPaths.allocate(paths, lookahead), _mask(ROAD_LANES)
        place, numbers = (*map(float, xy), np.nan), map(int, (lane, route))
        ask = bind(write_waypoints, self.roads, table)
        count, left_out = ask(int(m), place, *numbers, float(hint), mask, float(spacing), found)
        return [found.point[k, : found.length[k]] for k in range(count)], left_out


def _ints(values):
    return np.array(values, np.int32)


def _floats(values):
    return np.array(values, np.float64)


def _mask(kinds):
    return sum(1 << kind for kind in kinds)
