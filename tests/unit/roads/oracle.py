"""What sumolib and shapely say about places on a map: slow, and independent of the code under test."""

import numpy as np
import shapely
from sumolib.geomhelper import polygonOffsetAndDistanceToPoint

ROAD_USERS = ("passenger", "bus")


class Oracle:
    def __init__(self, net):
        self.lanes = {
            lane.getID(): lane
            for edge in net.getEdges(withInternal=True)
            if edge.getFunction() not in ("crossing", "walkingarea")
            for lane in edge.getLanes()
            if any(lane.allows(user) for user in ROAD_USERS)
        }
        self.ids = np.array(list(self.lanes))
        self.inside = np.array([name.startswith(":") for name in self.ids])
        self.width = np.array([lane.getWidth() for lane in self.lanes.values()])
        self.lines = np.array([shapely.LineString(lane.getShape()) for lane in self.lanes.values()])
        self.areas = shapely.buffer(self.lines, self.width / 2, cap_style="flat", quad_segs=32)
        self.wide_areas = shapely.buffer(self.lines, self.width, cap_style="flat", quad_segs=32)
        self.tree = shapely.STRtree(self.lines)
        outlines = [
            shapely.Polygon(node.getShape())
            for node in net.getNodes()
            if len(node.getShape()) > 2 and node.getType() != "dead_end"
        ]
        self.road = shapely.union_all([*self.areas, *outlines])
        shapely.prepare(self.road)

    def nearest_distance(self, point):
        """Return the distance to the centreline of the lane that the point is on, or else of the nearest.

        A road lane that holds the point decides together with the junction lanes that do; without one,
        junction lanes count up to their whole width to either side. NaN where the point is so near to the
        border of an area that rounding decides.
        """
        close = self.tree.query(shapely.buffer(point, self.width.max()))
        distance = shapely.distance(self.lines[close], point)
        narrow, wide = self.areas[close], self.wide_areas[close]
        borders = np.concatenate((shapely.boundary(narrow), shapely.boundary(wide)))
        if len(close) and shapely.distance(borders, point).min() < 2e-3:
            return np.nan
        holds = shapely.contains_xy(narrow, point.x, point.y)
        if (holds & ~self.inside[close]).any():
            return distance[holds].min()
        reaches = self.inside[close] & shapely.contains_xy(wide, point.x, point.y)
        if reaches.any():
            return distance[reaches].min()
        return shapely.distance(self.lines[self.tree.nearest(point)], point)

    def on_lane(self, lane_id, x, y):
        """Return s, distance, and the sign of t of a point with respect to a lane, as sumolib reckons."""
        shape = self.lanes[lane_id].getShape()
        s, distance = polygonOffsetAndDistanceToPoint((x, y), shape)
        line = shapely.LineString(shape)
        foot, ahead = line.interpolate(s), line.interpolate(s + 1e-4)
        behind = line.interpolate(max(0.0, s - 1e-4))
        side = (ahead.x - behind.x) * (y - foot.y) - (ahead.y - behind.y) * (x - foot.x)
        return s, distance, np.sign(side)

    def on_road(self, points):
        """Return whether points are on the road, and how far they are from its border [m]."""
        return shapely.contains_xy(self.road, points), shapely.distance(
            shapely.boundary(self.road), shapely.points(points)
        )
