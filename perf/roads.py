"""Speed of maps and road kernels beside plain NumPy and shapely, measured side by side in one run.

python perf/roads.py [--poses 10000] [--repeats 7]
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely

from smarts.geometry.binding import bind
from smarts.roads import footprints, kernels
from smarts.roads.atlas import ROAD_LANES, NearestLanes, RoadAtlas
from smarts.roads.compile import compile_map
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.routes import random_route, shortest_route
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net
from smarts.roads.waypoints import WaypointPaths, write_waypoints

CITY = """<configuration>
    <rand value="true"/> <rand.iterations value="130"/> <seed value="3"/>
    <rand.max-distance value="250"/> <default.lanenumber value="2"/>
</configuration>"""
LOOKAHEAD, PATHS = 20, 4


def best_of(repeats: int, *tasks: Callable[[], object]) -> list[float]:
    """Return each task's shortest time [s]; the tasks take turns, so that all see the same machine."""
    times = [[] for _ in tasks]
    for task in tasks:
        task()
    for _ in range(repeats):
        for task, measured in zip(tasks, times, strict=True):
            begin = time.perf_counter()
            task()
            measured.append(time.perf_counter() - begin)
    return [min(measured) for measured in times]


def report_loading(folder: Path, repeats: int) -> LaneGraph:
    """Print the times from source to atlas, and return the graph."""
    (folder / "map.netgcfg").write_text(CITY)
    source, net, saved = find_map_source(folder), folder / "city.net.xml", folder / "lanes.npz"
    compile_map(source, net)
    graph = read_net(net)
    graph.save(saved)
    compiled, cold, cached, atlas = best_of(
        min(repeats, 3),
        lambda: compile_map(source, net),
        lambda: read_net(net),
        lambda: LaneGraph.load(saved),
        lambda: RoadAtlas([graph]),
    )
    megabytes = net.stat().st_size / 1e6
    print(f"city: {megabytes:.2f} MB net, {len(graph.lane_ids)} lanes, {len(graph.point_s)} points")
    print(f"  compile {compiled:.3f} s   cold read {cold:.3f} s ({cold / megabytes:.2f} s/MB)")
    print(f"  cached load {cached:.4f} s ({cold / cached:.0f} times faster than cold)   atlas {atlas:.3f} s")
    return graph


class Plain:
    """The same questions, answered with shapely's vectorised calls and with NumPy."""

    def __init__(self, graph: LaneGraph) -> None:
        self.graph = graph
        self.lines = np.array(
            [shapely.LineString(graph.centreline(lane)) for lane in range(len(graph.length))]
        )
        self.tree = shapely.STRtree(self.lines)
        areas = shapely.buffer(self.lines, graph.width / 2, cap_style="flat")
        outlines = [graph.junction_outline(junction) for junction in range(len(graph.junction_ids))]
        self.road = shapely.union_all([*areas, *(shapely.Polygon(o) for o in outlines if len(o))])
        shapely.prepare(self.road)
        last = graph.point_start[1:] - 1
        self.segments = np.setdiff1d(np.arange(len(graph.point_s)), last)

    def locate(self, places: np.ndarray) -> np.ndarray:
        """Return s on the nearest lane, by shapely's tree."""
        points = shapely.points(places)
        lane = self.tree.nearest(points)
        return shapely.line_locate_point(self.lines[lane], points)

    def locate_with_numpy(self, places: np.ndarray) -> list[int]:
        """Return the nearest segment, looking at all of them."""
        begin = self.graph.point_xy[self.segments]
        direction = self.graph.point_xy[self.segments + 1] - begin
        square = (direction**2).sum(axis=1)
        nearest = []
        for place in places:
            offset = place - begin
            share = np.clip((offset * direction).sum(axis=1) / square, 0, 1)[:, None]
            nearest.append(int(((offset - share * direction) ** 2).sum(axis=1).argmin()))
        return nearest

    def on_road(self, places: np.ndarray) -> np.ndarray:
        """Return which places are on the road, by one prepared polygon."""
        return shapely.contains_xy(self.road, places)

    def waypoints(
        self, lanes: np.ndarray, stations: np.ndarray, routes: list[tuple[str, ...]]
    ) -> list[np.ndarray]:
        """Return one path for each vehicle, in its own lane, by np.interp."""
        graph, paths = self.graph, []
        for lane, s, route in zip(lanes, stations, routes, strict=True):
            edges, points, left = {graph.edge_number(name) for name in route}, [], LOOKAHEAD
            while left > 0:
                rows = slice(graph.point_start[lane], graph.point_start[lane + 1])
                at = np.arange(s, float(graph.length[lane]) + 1e-9, 1.0)[:left]
                xy = graph.point_xy[rows]
                points.append([np.interp(at, graph.point_s[rows], xy[:, axis]) for axis in (0, 1)])
                left -= len(at)
                ahead = [
                    n for n in graph.successors(lane) if graph.is_internal[n] or graph.lane_edge[n] in edges
                ]
                if not ahead:
                    break
                s, lane = s + len(at) - graph.length[lane], ahead[0]
            paths.append(np.concatenate(points, axis=1))
        return paths


def report_kernels(graph: LaneGraph, count: int, repeats: int) -> None:
    """Print microseconds per pose of each kernel, and the ratio to a plain way."""
    generator = np.random.default_rng(0)
    atlas, plain = RoadAtlas([graph]), Plain(graph)
    world = np.zeros(count, np.int32)
    begins = [random_route(graph, generator, max_edges=4) for _ in range(count // 10)]
    table = atlas.route_table([(0, route) for route in begins])
    number = np.arange(count, dtype=np.int32) % len(begins)
    routes = [begins[n] for n in number]
    lane = np.array([graph.lane_number(route[0], 0) for route in routes], np.int32)
    s = generator.uniform(0, 1, count) * graph.length[lane]
    places, heading = np.empty((count, 2)), np.empty(count)
    aside = generator.normal(scale=0.8, size=count)
    bind(kernels.poses_at, atlas.roads)(world, lane, s, aside, places, heading)
    found, paths = NearestLanes.allocate(count), WaypointPaths.allocate(PATHS, LOOKAHEAD)
    mask, unknown = sum(1 << kind for kind in ROAD_LANES), np.full(count, np.nan)
    locate, is_on_road = bind(kernels.locate, atlas.roads, table), bind(footprints.is_on_road, atlas.roads)
    write = bind(write_waypoints, atlas.roads, table)
    no_route = np.full(count, -1, np.int32)
    points = places.tolist()
    starts = [*zip(points, zip(lane.tolist(), number.tolist(), strict=True), strict=True)]
    few = places[:50]

    def row(name: str, kernel: Callable, plain_name: str, other: Callable, share: float = 1.0) -> None:
        ours, theirs = best_of(repeats, kernel, other)
        mine, its = ours / count * 1e6, theirs / (count * share) * 1e6
        print(f"  {name:34s} {mine:8.2f} us   {plain_name:28s} {its:9.2f} us   ratio {its / mine:7.1f}")

    print(f"kernels: {count} poses on one core, time per pose")
    row(
        "nearest lane, s, t",
        lambda: locate(world, places, unknown, unknown, no_route, mask, *found),
        "shapely STRtree",
        lambda: plain.locate(places),
    )
    row(
        "nearest lane, s, t",
        lambda: locate(world, places, unknown, unknown, no_route, mask, *found),
        "NumPy, all segments",
        lambda: plain.locate_with_numpy(few),
        50 / count,
    )
    row(
        "with heading and route",
        lambda: locate(world, places, unknown, heading, number, mask, *found),
        "shapely STRtree",
        lambda: plain.locate(places),
    )
    row(
        "on road",
        lambda: [is_on_road(0, x, y, np.nan, mask, True) for x, y in points],
        "shapely, prepared union",
        lambda: plain.on_road(places),
    )
    row(
        f"waypoints, {PATHS} x {LOOKAHEAD} along route",
        lambda: [write(0, (x, y, np.nan), *at, np.nan, mask, 1.0, paths) for (x, y), at in starts],
        "np.interp, own lane only",
        lambda: plain.waypoints(lane[:50], s[:50], routes[:50]),
        50 / count,
    )
    ends = [(route[0], other[-1]) for route, other in itertools.pairwise(begins[:50])]
    (search,) = best_of(repeats, lambda: [shortest_route(graph, *pair) for pair in ends])
    print(f"  a route search through the city: {search / len(ends) * 1e3:.2f} ms")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        graph = report_loading(Path(folder), options.repeats)
    report_kernels(graph, options.poses, options.repeats)


if __name__ == "__main__":
    main()
