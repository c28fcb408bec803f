import math
import re

import numpy as np
import pytest

from smarts.roads.lane_graph import LaneKind
from smarts.roads.permissions import lane_kind
from smarts.roads.sumo_net import read_net

from . import maps


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
