import math
import re

import numpy as np
import pytest

from smarts.roads.lane_graph import LaneKind
from smarts.roads.permissions import lane_kind
from smarts.roads.sumo_net import read_net

from . import maps


def ids(graph, lanes):
    return [graph.lane_ids[lane] for lane in lanes]


def test_lanes_of_a_cross(cross):
    lane = cross.lane_number("west_in", 0)
    assert len(cross.road_edges) == 8
    assert (cross.width[lane], cross.speed_limit[lane]) == (3.2, 15.0)
    assert cross.length[lane] == pytest.approx(89.6)
    assert not cross.is_internal[lane]
    assert cross.junction_ids[cross.edge_to[cross.lane_edge[lane]]] == "centre"
    assert cross.junction_ids[cross.edge_from[cross.lane_edge[lane]]] == "west"


def test_neighbours(graphs):
    bend = graphs["curve"]
    right, middle, left = (bend.lane_number("bend", index) for index in range(3))
    assert (bend.right[right], bend.left[right]) == (-1, middle)
    assert (bend.right[middle], bend.left[middle]) == (right, left)
    assert (bend.right[left], bend.left[left]) == (middle, -1)
    back = bend.lane_number("back", 0)
    assert (bend.right[back], bend.left[back]) == (-1, -1)


def test_a_left_turn_has_two_lanes_inside_the_junction(cross):
    lane = cross.lane_number("west_in", 1)
    straight, turn = cross.successors(lane)
    assert cross.is_internal[[straight, turn]].all()
    assert ids(cross, cross.successors(straight)) == ["east_out_1"]
    (second,) = cross.successors(turn)
    assert cross.is_internal[second]
    assert ids(cross, cross.successors(second)) == ["north_out_1"]
    assert cross.predecessors(second).tolist() == [turn]
    assert cross.predecessors(turn).tolist() == [lane]
    assert cross.junction_ids[cross.lane_junction[turn]] == "centre"


def test_links_equal_sumolibs(graphs, sumo_nets):
    for name, graph in graphs.items():
        expected = set()
        for edge in sumo_nets[name].getEdges(withInternal=False):
            for lane in edge.getLanes():
                for link in lane.getOutgoing():
                    expected.add((lane.getID(), link.getViaLaneID() or link.getToLane().getID()))
        found = {
            (graph.lane_ids[lane], graph.lane_ids[after])
            for lane in np.flatnonzero(~graph.is_internal)
            for after in graph.successors(lane)
        }
        assert found == expected


def test_centrelines(graphs):
    for graph in graphs.values():
        for lane in range(len(graph.lane_ids)):
            rows = slice(graph.point_start[lane], graph.point_start[lane + 1])
            steps = np.hypot(*np.diff(graph.point_xy[rows], axis=0).T)
            assert steps.min() > 0
            assert steps.max() <= 1 + 1e-9
            np.testing.assert_allclose(np.diff(graph.point_s[rows]), steps, atol=1e-9)
            turn = np.abs(np.angle(np.exp(1j * np.diff(graph.point_heading[rows]))))
            assert turn.max() < 0.6
        assert (graph.point_heading <= math.pi).all()
        assert (graph.point_heading > -math.pi).all()


def test_lanes_begin_where_those_before_end(graphs):
    for graph in graphs.values():
        for lane in range(len(graph.lane_ids)):
            for after in graph.successors(lane):
                gap = graph.centreline(after)[0] - graph.centreline(lane)[-1]
                assert np.hypot(*gap) < 0.01


def test_signals(cross, graphs):
    assert cross.signal_ids == ("centre",)
    links = []
    for arm in maps.ARMS:
        for index in range(2):
            for lane in cross.successors(cross.lane_number(f"{arm}_in", index)):
                assert cross.signal[lane] == 0
                links.append(int(cross.signal_link[lane]))
    assert sorted(links) == list(range(16))
    assert (cross.signal[~cross.is_internal] == -1).all()
    assert (graphs["roundabout"].signal == -1).all()


def test_roundabout(graphs):
    graph = graphs["roundabout"]
    ring = {graph.edge_ids[edge] for edge in np.flatnonzero(graph.edge_is_roundabout)}
    assert ring == {"ring_east", "ring_north", "ring_west", "ring_south"}


def test_junction_outlines(cross):
    centre = cross.junction_outline(cross.junction_ids.index("centre"))
    assert np.abs(centre).max() == pytest.approx(10.4)
    assert len(cross.junction_outline(cross.junction_ids.index("west"))) == 0


def test_lane_kinds(compile_to):
    graph = read_net(compile_to("kinds", maps.lane_kinds()))
    kinds = [LaneKind(graph.kind[graph.lane_number("road", index)]) for index in range(5)]
    assert kinds == [LaneKind.FOOT, LaneKind.BICYCLE, LaneKind.BUS, LaneKind.CAR, LaneKind.CLOSED]


@pytest.mark.parametrize(
    ("allow", "disallow", "surface", "kind"),
    [
        ("", "", "", LaneKind.CAR),
        ("all", "", "", LaneKind.CAR),
        ("", "passenger bicycle", "", LaneKind.BUS),
        ("", "all", "shoulder", LaneKind.SHOULDER),
        ("tram", "", "", LaneKind.RAIL),
        ("rail_urban", "", "", LaneKind.RAIL),
        ("", "passenger bus coach bicycle", "", LaneKind.FOOT),
        ("emergency", "", "", LaneKind.CLOSED),
    ],
)
def test_lane_kind(allow, disallow, surface, kind):
    assert lane_kind(allow, disallow, surface) is kind


def test_length_attribute_of_sumo_is_kept_apart(compile_to):
    sources = maps.cross()
    sources["edg"] = sources["edg"].replace('<edge id="west_in" ', '<edge id="west_in" length="197.1" ')
    graph = read_net(compile_to("long", sources))
    lane = graph.lane_number("west_in", 0)
    assert graph.length[lane] == pytest.approx(89.6)
    assert graph.sumo_length[lane] == pytest.approx(197.1)


def test_opposite_lane(compile_to):
    graph = read_net(
        compile_to(
            "opposite",
            {
                "nod": '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>',
                "edg": """<edges>
                    <edge id="there" from="a" to="b"><lane index="0"><neigh lane="back_0"/></lane></edge>
                    <edge id="back" from="b" to="a"/>
                </edges>""",
            },
        )
    )
    assert ids(graph, [graph.opposite[graph.lane_number("there", 0)]]) == ["back_0"]


def test_an_internal_lane_of_a_centimetre_points_where_the_lane_before_does(tmp_path, nets):
    """Its points are rounded to centimetres, so that their direction is anything; here it points back."""
    graph = read_net(nets["cross"])
    before = graph.lane_number("west_in", 0)
    inside = next(n for n in graph.successors(before) if "east" in graph.lane_ids[graph.successors(n)[0]])
    x, y = graph.centreline(before)[-1]
    shape = re.escape(graph.lane_ids[inside])
    net = tmp_path / "map.net.xml"
    text = re.sub(
        rf'(<lane id="{shape}"[^>]*shape=")[^"]*"',
        rf'\g<1>{x:.2f},{y:.2f} {x - 0.01:.2f},{y:.2f}"',
        nets["cross"].read_text(),
    )
    net.write_text(text)
    short = read_net(net)
    assert short.length[inside] < 0.1
    headings = short.point_heading[short.point_start[inside] : short.point_start[inside + 1]]
    assert headings == pytest.approx([graph.point_heading[graph.point_start[before]]] * len(headings))
