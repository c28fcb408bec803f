"""Routes that an atlas does not take, poses that are nowhere, and many lanes in one place."""

import itertools

import numpy as np
import pytest

from smarts.errors import MapError
from smarts.roads.lane_graph import LaneKind
from smarts.roads.sumo_net import read_net
from tests.raising import raises
from tests.road_queries import RoadQueries

from . import maps


@pytest.fixture(scope="module")
def atlas(graphs):
    return RoadQueries([graphs["cross"], graphs["curve"]])


def zeros(*shape):
    return np.zeros(shape, np.int32)


@pytest.mark.parametrize("value", [np.nan, 1e300])
def test_a_vehicle_that_is_nowhere_has_no_paths_though_it_names_a_lane(atlas, value):
    position = np.array([[-50.0, -4.8], [value, -4.8], [-50.0, value], [value, value]])
    lane = np.full(4, atlas.graphs[0].lane_number("west_in", 0))
    paths = atlas.waypoints(atlas.no_routes, zeros(4), position, lane, np.full(4, -1))
    assert paths.path_count.tolist() == [2, 0, 0, 0]
    assert not paths.waypoint_count[1:].any()


def test_a_route_on_a_road_closed_to_its_lanes_users(atlas):
    with raises(MapError, values=["west_in", "RAIL"]):
        atlas.route_table([(0, ("west_in",))], frozenset({LaneKind.RAIL}))


def test_eighty_lanes_in_one_place_are_all_considered(compile_to):
    edges = "".join(f'<edge id="e{n}" from="a{n}" to="b{n}" numLanes="1"/>' for n in range(80))
    ends = "".join(
        f'<node id="a{n}" x="0" y="{n / 100}"/><node id="b{n}" x="90" y="{n / 100}"/>' for n in range(80)
    )
    net = compile_to("stack", {"nod": f"<nodes>{ends}</nodes>", "edg": f"<edges>{edges}</edges>"})
    graph = read_net(net)
    stack = RoadQueries([graph])
    routes = [(0, (f"e{n}",)) for n in range(80)]
    position = np.tile([45.0, -1.6], (80, 1))
    found = stack.locate(zeros(80), position, routes=np.arange(80), table=stack.route_table(routes))
    assert [graph.lane_ids[lane] for lane in found.lane] == [f"e{n}_0" for n in range(80)]


def test_many_branches_still_to_follow(graphs):
    """Of a long way through the city with hundreds of forks, K paths are the first K of all."""
    graph = graphs["city"]
    city = RoadQueries([graph])
    lookahead, room = 8000, 100

    def branches(lane):
        """Return how many branches the first path leaves behind."""
        left, count = lookahead, 0
        while left > 0 and len(following := graph.successors(lane)):
            left, count, lane = left - graph.length[lane], count + len(following) - 1, following[0]
        return count

    lane = max(np.flatnonzero(~graph.is_internal), key=branches)
    assert branches(lane) > 70
    x, y, _ = graph.pose_at(lane, 3.0)

    def ways(lane, left):
        """Yield the lanes of all paths in order, `left` metres long."""
        following = graph.successors(lane)
        if graph.length[lane] > left or not len(following):
            yield [lane]
            return
        for other in following:
            for way in ways(int(other), left - graph.length[lane]):
                yield [lane, *way]

    paths = city.waypoints(
        city.no_routes,
        zeros(1),
        np.array([[x, y]]),
        np.array([lane]),
        np.array([-1]),
        paths=room,
        lookahead=lookahead,
    )
    beside = graph.edge_lanes(int(graph.lane_edge[lane]))
    starts = [city.project(zeros(1), np.array([n]), np.array([[x, y]]))[0][0] for n in beside]
    every = (way for n, s in zip(beside, starts, strict=True) for way in ways(n, lookahead - 1 + s))
    assert paths.path_count.tolist() == [room]
    for path, way in enumerate(itertools.islice(every, room)):
        lanes = paths.lane[0, path, : paths.waypoint_count[0, path]]
        found = lanes[np.flatnonzero(np.diff(lanes, prepend=-1))]
        # Lanes shorter than the spacing may have no waypoint.
        assert set(found) <= set(way)
        assert [n for n in found if graph.length[n] > 1.0] == [n for n in way if graph.length[n] > 1.0]


def test_drawn_metres_where_sumo_counts_others(compile_to):
    """SUMO may declare another length than it draws; nothing here is in SUMO's metres."""
    sources = maps.cross()
    sources["edg"] = sources["edg"].replace('<edge id="west_in" ', '<edge id="west_in" length="197.1" ')
    graph = read_net(compile_to("declared", sources))
    declared, lane = RoadQueries([graph]), np.array([graph.lane_number("west_in", 0)])
    assert graph.sumo_length[lane[0]] == pytest.approx(197.1)
    position, _ = declared.poses(zeros(1), lane, np.array([50.0]), np.zeros(1))
    assert position[0] == pytest.approx([-50.0, -4.8])
    assert declared.locate(zeros(1), position).s == pytest.approx([50.0])
    assert declared.project(zeros(1), lane, position)[0] == pytest.approx([50.0])
    routes = declared.route_table([(0, ("west_in", "east_out"))])
    done, remaining = declared.route_distances(routes, zeros(1), zeros(1), lane, np.array([50.0]))
    assert (done[0], remaining[0]) == pytest.approx((50.0, 89.6 - 50.0 + 20.8 + 89.6))
    paths = declared.waypoints(routes, zeros(1), position, lane, zeros(1), spacing=10.0)
    offsets = paths.lane_offset[0, 0, : paths.waypoint_count[0, 0]]
    assert offsets[:4] == pytest.approx([50.0, 60.0, 70.0, 80.0])
    assert offsets[4] == pytest.approx(90.0 - 89.6)
