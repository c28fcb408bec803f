import itertools

import numpy as np
import pytest

from smarts.errors import MapError
from smarts.geometry.binding import bind
from smarts.roads.atlas import RoadAtlas
from smarts.roads.corridors import route_corridor
from smarts.roads.lane_graph import LaneKind
from smarts.roads.lane_ways import next_row, row_of
from smarts.roads.routes import CARS, edge_graph, random_route, shortest_route
from smarts.roads.sumo_net import read_net
from tests.maps import Road, graph_of
from tests.raising import raises

from . import maps

# Two ways from a to d: 100 m at 10 m/s by b, or 200 m at 30 m/s by c.
DIAMOND = {
    "nod": """<nodes>
        <node id="s" x="-100" y="0"/> <node id="a" x="0" y="0"/> <node id="d" x="100" y="0"/>
        <node id="t" x="200" y="0"/> <node id="c" x="50" y="90"/>
    </nodes>""",
    "edg": """<edges>
        <edge id="in" from="s" to="a" numLanes="1" speed="10"/>
        <edge id="short" from="a" to="d" numLanes="1" speed="10"/>
        <edge id="fast_1" from="a" to="c" numLanes="1" speed="40"/>
        <edge id="fast_2" from="c" to="d" numLanes="1" speed="40"/>
        <edge id="out" from="d" to="t" numLanes="1" speed="10"/>
    </edges>""",
}


@pytest.fixture(scope="module")
def diamond(compile_to):
    return read_net(compile_to("diamond", DIAMOND))


def test_shortest_by_length_and_by_time(diamond):
    assert shortest_route(diamond, "in", "out") == ("in", "short", "out")
    assert shortest_route(diamond, "in", "out", cost="time") == ("in", "fast_1", "fast_2", "out")


def test_via(diamond):
    assert shortest_route(diamond, "in", "out", via=["fast_2"]) == ("in", "fast_1", "fast_2", "out")


def test_a_lap_of_the_ring(graphs):
    ring = ("ring_east", "ring_north", "ring_west", "ring_south", "ring_east")
    assert shortest_route(graphs["roundabout"], "ring_east", "ring_east", lap=True) == ring
    assert shortest_route(graphs["roundabout"], "ring_east", "ring_east") == ("ring_east",)


def test_no_way(diamond):
    with raises(MapError, values=["fast_1", "short", "fast_2"]):
        shortest_route(diamond, "in", "out", via=["fast_1", "short"])
    with raises(MapError, values=["'out'", "'in'"]):
        shortest_route(diamond, "out", "in")
    with raises(MapError, values=["'in'"]):
        shortest_route(diamond, "in", "in", lap=True)


def test_unknown_and_unusable_edges(diamond, cross, compile_to):
    with raises(MapError, values=["shorter", "'short'"]):
        shortest_route(diamond, "in", "shorter")
    with raises(MapError, values=["':centre_0'"]):
        shortest_route(cross, ":centre_0", "west_out")
    sources = dict(DIAMOND)
    sources["edg"] = sources["edg"].replace('id="short"', 'id="short" allow="bus"')
    graph = read_net(compile_to("buses", sources))
    assert shortest_route(graph, "in", "out") == ("in", "fast_1", "fast_2", "out")
    with raises(MapError, values=["'short'"]):
        shortest_route(graph, "in", "short")
    both = frozenset({LaneKind.CAR, LaneKind.BUS})
    assert shortest_route(graph, "in", "out", kinds=both) == ("in", "short", "out")


def test_equals_sumolibs_shortest_path(graphs, sumo_nets):
    graph, net = graphs["city"], sumo_nets["city"]
    generator = np.random.default_rng(1)
    reachable = 0
    edges = edge_graph(graph)
    for begin, end in generator.choice(graph.road_edges, (30, 2)):
        if begin == end:
            continue
        path, _ = net.getOptimalPath(net.getEdge(begin), net.getEdge(end), includeFromToCost=False)
        if path is None:
            with pytest.raises(MapError):
                shortest_route(graph, begin, end)
            continue
        reachable += 1
        route = shortest_route(graph, begin, end)
        assert cost_of(graph, edges, route) <= cost_of(graph, edges, [edge.getID() for edge in path]) + 1e-9
    assert reachable > 10


def cost_of(graph, edges, route):
    numbers = [graph.edge_number(name) for name in route]
    crossings = sum(edges.onward[a][b] for a, b in itertools.pairwise(numbers))
    return crossings + sum(edges.cost[edge] for edge in numbers[1:])


def test_random_routes(graphs):
    graph = graphs["city"]
    generator = np.random.default_rng(5)
    routes = [random_route(graph, generator, max_edges=6) for _ in range(50)]
    assert len(set(routes)) > 40
    assert {len(route) for route in routes} <= set(range(2, 7))
    for route in routes:
        route_corridor(graph, route)
    again = np.random.default_rng(5)
    assert [random_route(graph, again, max_edges=6) for _ in range(50)] == routes


def test_random_routes_have_no_turnarounds(compile_to):
    """A dead end that vehicles may leave by turning round: the only way out of `in` is `back`."""
    nodes = (
        '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="200" y="0"/></nodes>'
    )
    ends = (("in", "b", "c"), ("back", "c", "b"), ("away", "b", "a"))
    edges = "".join(f'<edge id="{name}" from="{begin}" to="{end}"/>' for name, begin, end in ends)
    turn = '<connections><connection from="in" to="back" fromLane="0" toLane="0"/></connections>'
    sources = {"nod": nodes, "edg": f"<edges>{edges}</edges>", "con": turn}
    graph = read_net(compile_to("turnaround", sources))
    assert shortest_route(graph, "in", "away") == ("in", "back", "away")
    generator = np.random.default_rng(1)
    assert {random_route(graph, generator) for _ in range(20)} == {("back", "away")}


def test_corridor_of_a_left_turn(cross):
    corridor = route_corridor(cross, ("west_in", "north_out"))
    names = [cross.lane_ids[lane] for lane in corridor.lane]
    inside = [name for name in names if name.startswith(":")]
    assert names == ["west_in_0", "west_in_1", *inside, "north_out_0", "north_out_1"]
    assert len(inside) == 2
    first, second = (cross.length[cross.lane_of_id(name)] for name in inside)
    assert corridor.begin.tolist() == pytest.approx(
        [0, 0, 89.6, 89.6 + first, 89.6 + first + second, 89.6 + first + second]
    )
    assert corridor.length == pytest.approx(89.6 + first + second + 89.6)
    onward = [
        corridor.onward[a:b].tolist()
        for a, b in zip(corridor.onward_start[:-1], corridor.onward_start[1:], strict=True)
    ]
    assert onward == [[], [2], [3], [5], [], []]
    assert corridor.before.tolist() == [-1, -1, -1, 2, -1, -1]


def test_corridor_with_a_gap(cross):
    with raises(MapError, values=["west_in", "west_out"]):
        route_corridor(cross, ("west_in", "west_out"))


def test_lane_changes_that_a_route_demands():
    # Only lane 2 of "a" leads on, to lane 0 of "b".
    roads = {"a": Road([(0.0, 0.0), (100.0, 0.0)], 3), "b": Road([(110.0, 6.4), (200.0, 6.4)], 2)}
    corridor = route_corridor(graph_of(roads, [(("a", 2), ("b", 0))]), ("a", "b"))
    to_right, to_left = corridor.changes[:, 1], corridor.changes[:, 0]
    assert to_right.tolist() == [2, 1, 0, 0, 0, -1]
    assert to_left.tolist() == [3, 2, 1, 1, 1, 0]


def test_lane_changes_of_cars_do_not_lead_into_bus_lanes(compile_to):
    """The right lane, for buses, and the left one lead on; the middle one turns off."""
    sources = maps.bus_lane()
    sources["edg"] = """<edges><edge id="in" from="a" to="b" numLanes="3"><lane index="0" allow="bus"/></edge>
        <edge id="side" from="b" to="d"/><edge id="out" from="b" to="c" numLanes="2"/></edges>"""
    ways = (0, "out", 0), (1, "side", 0), (2, "out", 1)
    links = "".join(
        f'<connection from="in" to="{edge}" fromLane="{lane}" toLane="{to}"/>' for lane, edge, to in ways
    )
    graph = read_net(compile_to("middle", sources | {"con": f"<connections>{links}</connections>"}))
    corridor = route_corridor(graph, ("in", "out"), CARS | {LaneKind.BUS})
    to_right = dict(
        zip((graph.lane_ids[lane] for lane in corridor.lane), corridor.changes[:, 1], strict=True)
    )
    assert (to_right["in_0"], to_right["in_1"], to_right["in_2"]) == (0, 2, -1)


def test_lane_changes_to_where_no_way_leads():
    roads = {"a": Road([(0.0, 0.0), (100.0, 0.0)], 2)}
    assert route_corridor(graph_of(roads), ("a",)).changes.tolist() == [[1, 0], [0, -1]]


@pytest.mark.parametrize("route", [("in", "out"), ()])
def test_a_lane_for_cars_leads_into_a_bus_lane_only_if_it_leads_nowhere_else(compile_to, route):
    graph = read_net(compile_to("bus_lane", maps.bus_lane()))
    atlas = RoadAtlas([graph])
    table = atlas.route_table([(0, route)] if route else [])
    begin, ends = graph.lane_number("in", 0), set()
    ahead = bind(next_row, atlas.roads, table)
    row = bind(row_of, table)(0, 0 if route else -1, begin, 0, 0.0)
    onward = table.lane[table.onward[table.onward_start[row] : table.onward_start[row + 1]]]
    assert {LaneKind.CAR, LaneKind.BUS} == set(graph.kind[onward].tolist())
    while row >= 0:
        ends.add(graph.lane_ids[table.lane[row]])
        row = ahead(0, row, 0)
    assert ends & {"out_1", "side_0"}
    assert "out_0" not in ends
