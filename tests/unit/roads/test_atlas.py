"""What the atlas refuses: kernels check nothing, so a wrong number would read or write foreign memory."""

import itertools

import numpy as np
import pytest

from smarts.errors import MapError
from smarts.roads import packing
from smarts.roads.atlas import LanePositions, RoadAtlas
from smarts.roads.lane_graph import LaneKind
from smarts.roads.sumo_net import read_net
from smarts.roads.waypoints import WaypointPaths

from . import maps

E = 5


@pytest.fixture(scope="module")
def atlas(graphs):
    return RoadAtlas([graphs["cross"], graphs["curve"]])


@pytest.fixture(scope="module")
def table(atlas):
    return atlas.route_table([(0, ("west_in", "east_out")), (1, ("bend", "straight"))])


def zeros(*shape):
    return np.zeros(shape, np.int32)


def arguments(table):
    """Sound arguments of each method, for E poses."""
    place, real = np.full((E, 2), -50.0), np.ones(E)
    return {
        "locate": dict(
            maps=zeros(E), position=place, heading=real, routes=zeros(E), table=table,
            out=LanePositions.allocate(E),
        ),
        "project": dict(maps=zeros(E), lane=zeros(E), position=place),
        "poses": dict(maps=zeros(E), lane=zeros(E), s=real, t=real),
        "on_road": dict(maps=zeros(E), position=place),
        "corners_on_road": dict(maps=zeros(E), position=place, heading=real, length=real, width=real),
        "route_distances": dict(
            table=table, maps=zeros(E), routes=zeros(E), lane=zeros(E), s=real, hint=real
        ),
        "waypoints": dict(
            table=table, maps=zeros(E), position=place, lane=zeros(E), routes=zeros(E), hint=real,
            out=WaypointPaths.allocate(E, 4, 8),
        ),
    }  # fmt: skip


METHODS = tuple(arguments(None))


@pytest.mark.parametrize("method", METHODS)
def test_arrays_of_unequal_length_are_refused(atlas, table, method):
    sound = arguments(table)[method]
    getattr(atlas, method)(**sound)
    for name, value in sound.items():
        if name in ("table", "out"):
            continue
        for wrong in (value[:-1], np.concatenate((value, value)), value[:, None], value[0]):
            # Where it is the maps that are wrong, all others are.
            with pytest.raises((ValueError, TypeError), match=r"shape|len"):
                getattr(atlas, method)(**sound | {name: wrong})


@pytest.mark.parametrize("wrong", [-1, 2, 50, 2**31 - 1, -(2**31)])
@pytest.mark.parametrize("method", METHODS)
def test_maps_that_there_are_not(atlas, table, method, wrong):
    sound = arguments(table)[method]
    sound["maps"][3] = wrong
    with pytest.raises(ValueError, match=rf"maps\[3\] is {wrong}, but maps go from 0 to 1"):
        getattr(atlas, method)(**sound)


@pytest.mark.parametrize("method", [name for name in METHODS if "lane" in arguments(None)[name]])
def test_lanes_that_there_are_not(atlas, table, method):
    sound = arguments(table)[method]
    counts = [len(graph.lane_ids) for graph in atlas.graphs]
    assert counts[0] > counts[1], "so that a lane of one map may be none of the other"
    for world, wrong in ((0, counts[0]), (1, counts[1]), (1, counts[0] - 1), (0, -2), (1, 10**6)):
        sound["maps"][2], sound["lane"][2] = world, wrong
        with pytest.raises(
            ValueError, match=rf"lane\[2\] is {wrong}, .* map {world} .* {counts[world] - 1},"
        ):
            getattr(atlas, method)(**sound)
    for world in range(2):
        sound["maps"][2], sound["lane"][2] = world, counts[world] - 1
        getattr(atlas, method)(**sound)
    sound["lane"][:] = -1
    getattr(atlas, method)(**sound)


@pytest.mark.parametrize("method", [name for name in METHODS if "routes" in arguments(None)[name]])
def test_routes_that_there_are_not(atlas, table, method):
    for wrong in (2, 7, -2, 10**6):
        sound = arguments(table)[method]
        sound["routes"][4] = wrong
        with pytest.raises(ValueError, match=rf"routes\[4\] is {wrong}, but routes go from 0 to 1"):
            getattr(atlas, method)(**sound)
    with pytest.raises(ValueError, match=r"routes\[0\] is 0, but routes are none in this table"):
        getattr(atlas, method)(**arguments(atlas.no_routes)[method])


@pytest.mark.parametrize("method", [name for name in METHODS if "table" in arguments(None)[name]])
def test_tables_of_another_atlas(graphs, atlas, method):
    for others in (["cross"], ["curve", "cross"], ["city", "city"], ["cross", "curve", "curve"]):
        other = RoadAtlas([graphs[name] for name in others])
        with pytest.raises(ValueError, match="table is not of this atlas"):
            getattr(atlas, method)(**arguments(other.no_routes)[method])
    twin = RoadAtlas(atlas.graphs).route_table([(0, ("west_in", "east_out"))])
    getattr(atlas, method)(**arguments(twin)[method])


def test_buffers_that_do_not_fit(atlas, table):
    cases = {
        "locate": [LanePositions.allocate(n) for n in (0, 1, E + 1)],
        "waypoints": [WaypointPaths.allocate(n, 4, 8) for n in (0, 1, E + 1)],
    }
    good = LanePositions.allocate(E)
    cases["locate"].append(LanePositions(np.empty(E), good.s, good.t, good.distance))
    cases["locate"].append(LanePositions(good.lane, good.s, good.t, np.empty(1)))
    paths, narrow = WaypointPaths.allocate(E, 4, 8), WaypointPaths.allocate(E, 3, 7)
    for name in WaypointPaths._fields[1:]:
        cases["waypoints"].append(paths._replace(**{name: getattr(narrow, name)}))
        cases["waypoints"].append(paths._replace(**{name: getattr(paths, name)[:1]}))
    cases["waypoints"].append(paths._replace(heading=np.zeros(E)))
    cases["waypoints"].append(paths._replace(path_count=np.zeros(E, np.int64)))
    for method, buffers in cases.items():
        for out in buffers:
            with pytest.raises(ValueError, match=r"out\."):
                getattr(atlas, method)(**arguments(table)[method] | {"out": out})


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf, -np.inf, 1e300])
def test_waypoints_lie_ahead_of_each_other(atlas, table, spacing):
    with pytest.raises(ValueError, match="spacing is"):
        atlas.waypoints(**arguments(table)["waypoints"], spacing=spacing)


@pytest.mark.parametrize("name", ["paths", "lookahead"])
def test_no_room_for_waypoints(atlas, table, name):
    sound = arguments(table)["waypoints"] | {"out": None}
    for size in (0, -3):
        with pytest.raises(ValueError, match=f"{name} is {size}"):
            atlas.waypoints(**sound | {name: size})


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_a_vehicle_that_is_nowhere_has_no_paths_though_it_names_a_lane(atlas, value):
    position = np.array([[-50.0, -4.8], [value, -4.8], [-50.0, value], [value, value]])
    lane = np.full(4, atlas.graphs[0].lane_number("west_in", 0))
    paths = atlas.waypoints(atlas.no_routes, zeros(4), position, lane, np.full(4, -1))
    assert paths.path_count.tolist() == [2, 0, 0, 0]
    assert not paths.waypoint_count[1:].any()


@pytest.mark.parametrize("method", METHODS)
def test_numbers_that_are_not_finite_do_no_harm(atlas, table, method):
    for value in (np.nan, np.inf, -np.inf, 1e300, -1e300):
        sound = arguments(table)[method]
        for array in sound.values():
            if isinstance(array, np.ndarray) and array.dtype == np.float64:
                array[:] = value
        getattr(atlas, method)(**sound)


@pytest.mark.parametrize("method", METHODS)
def test_no_poses_at_all(atlas, table, method):
    sound = arguments(table)[method]
    empty = {name: array[:0] for name, array in sound.items() if isinstance(array, np.ndarray)}
    getattr(atlas, method)(**sound | empty | ({"out": None} if "out" in sound else {}))


def test_an_atlas_without_maps():
    with pytest.raises(ValueError, match="at least one map"):
        RoadAtlas([])


@pytest.mark.parametrize("world", [-1, 2])
def test_a_route_on_a_map_that_there_is_not(atlas, world):
    with pytest.raises(ValueError, match=rf"route 1 is on map {world}"):
        atlas.route_table([(0, ("west_in",)), (world, ("west_in",))])


def test_a_route_without_edges(atlas):
    with pytest.raises(MapError, match="route 1 of the table: a route without edges"):
        atlas.route_table([(0, ("west_in",)), (0, ())])


def test_a_route_on_a_road_closed_to_its_lanes_users(atlas):
    with pytest.raises(MapError, match="edge 'west_in' has no lane of kind RAIL"):
        atlas.route_table([(0, ("west_in",))], frozenset({LaneKind.RAIL}))


def test_eighty_lanes_in_one_place_are_all_considered(compile_to):
    edges = "".join(f'<edge id="e{n}" from="a{n}" to="b{n}" numLanes="1"/>' for n in range(80))
    ends = "".join(
        f'<node id="a{n}" x="0" y="{n / 100}"/><node id="b{n}" x="90" y="{n / 100}"/>' for n in range(80)
    )
    net = compile_to("stack", {"nod": f"<nodes>{ends}</nodes>", "edg": f"<edges>{edges}</edges>"})
    graph = read_net(net)
    stack = RoadAtlas([graph])
    routes = [(0, (f"e{n}",)) for n in range(80)]
    position = np.tile([45.0, -1.6], (80, 1))
    found = stack.locate(zeros(80), position, routes=np.arange(80), table=stack.route_table(routes))
    assert [graph.lane_ids[lane] for lane in found.lane] == [f"e{n}_0" for n in range(80)]


def test_more_lanes_in_one_place_than_kernels_have_room_for(cross, monkeypatch):
    monkeypatch.setattr(packing, "MOST_CANDIDATES", 10)
    with pytest.raises(MapError, match=r"on the map: \d+ lanes overlap within 6 m; at most 10 may"):
        RoadAtlas([cross])


def test_many_branches_still_to_follow(graphs):
    """Of a long way through the city with hundreds of forks, K paths are the first K of all."""
    graph = graphs["city"]
    city = RoadAtlas([graph])
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
    declared, lane = RoadAtlas([graph]), np.array([graph.lane_number("west_in", 0)])
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
