"""Roads above each other: heights of maps from each source, and lanes found at the right height."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from smarts.geometry.binding import bind
from smarts.roads.compile import compile_map
from smarts.roads.lane_ways import place_on_lane
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net
from tests.maps import bridge, ramp
from tests.road_queries import RoadQueries

from .maps import write

DATA = Path(__file__).parents[2] / "data"


def graph_from(folder):
    out = folder / "out.net.xml"
    compile_map(find_map_source(folder), out)
    return read_net(out)


def test_heights_of_a_sumo_map(tmp_path):
    """An edge of 200 m that climbs 10 m in its first half and is level in its second."""
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="200" y="0" z="10"/>'
    edge = '<edge id="road" from="a" to="b" shape="0,0,0 100,0,10 200,0,10"/>'
    graph = graph_from(write(tmp_path, nod=f"<nodes>{nodes}</nodes>", edg=f"<edges>{edge}</edges>"))
    lane = graph.lane_number("road", 0)
    # Arc lengths are those in the plane.
    assert graph.length[lane] == pytest.approx(200.0)
    found = [graph.height_at(lane, s) for s in (0.0, 50.0, 100.0, 150.0, 250.0)]
    assert found == pytest.approx([0.0, 5.0, 10.0, 10.0, 10.0])
    assert graph.has_levels


def test_heights_of_an_opendrive_map(tmp_path):
    """A road of 100 m whose profile is 5 m + 0.04 s."""
    text = (DATA / "bend.xodr").read_text()
    assert "elevationProfile" not in text
    profile = '<elevationProfile><elevation s="0" a="5" b="0.04" c="0" d="0"/></elevationProfile>'
    (tmp_path / "map.xodr").write_text(text.replace("</planView>", "</planView>" + profile))
    graph = graph_from(tmp_path)
    for lane in np.flatnonzero(~graph.is_internal).tolist():
        low, high = sorted((graph.height_at(lane, 0.0), graph.height_at(lane, float(graph.length[lane]))))
        assert low == pytest.approx(5.0, abs=0.02)
        assert high - low == pytest.approx(4.0, abs=0.02)


def test_heights_of_an_osm_map(tmp_path):
    """A bridge of layer 1 is raised by 8 m; the road below stays where grades allow it."""
    shutil.copy(DATA / "bridge.osm", tmp_path / "map.osm")
    graph = graph_from(tmp_path)
    middle = graph.point_xy[graph.point_z > 7.99].mean(axis=0)
    found = RoadQueries([graph]).locate([0, 0], np.stack([middle, middle]), height=[8.0, 0.0])
    roads = [graph.edge_ids[graph.lane_edge[lane]] for lane in found.lane]
    assert roads[0] in ("10", "-12")
    assert roads[1] in ("14", "15")
    above, below = (graph.height_at(*place) for place in zip(found.lane, found.s, strict=True))
    assert above == pytest.approx(8.0, abs=0.01)
    assert below < 3.0


@pytest.mark.parametrize("heading", [0.0, np.pi / 2, np.nan])
@pytest.mark.parametrize(("height", "lane"), [(0.0, 0), (2.9, 0), (5.1, 1), (8.0, 1)])
def test_a_lane_is_found_at_its_height_whatever_the_heading(height, lane, heading):
    queries = RoadQueries([bridge()])
    found = queries.locate([0], np.array([[0.4, -0.7]]), np.array([heading]), height=[height])
    assert found.lane.tolist() == [lane]
    assert found.t == pytest.approx([-0.7 if lane == 0 else -0.4])


def test_an_unknown_height_is_that_of_any_lane():
    queries = RoadQueries([bridge()])
    found = queries.locate([0, 0], np.zeros((2, 2)), np.array([0.0, np.pi / 2]), height=[np.nan, np.nan])
    assert found.lane.tolist() == [0, 1]


def test_beside_a_bridge_there_is_no_road_of_another_level():
    """10 m beside the bridge is the middle of the road below."""
    queries = RoadQueries([bridge()])
    place = np.array([[10.0, 0.0]])
    assert queries.on_road([0], place, height=0.0).tolist() == [True]
    assert queries.on_road([0], place, height=8.0).tolist() == [False]
    found = queries.locate([0], place, height=[8.0])
    assert (found.lane.tolist(), found.distance) == ([1], pytest.approx([10.0]))


@pytest.mark.parametrize(("height", "s"), [(1.7, 60.0), (9.2, 328.5)])
def test_a_place_on_a_lane_that_leads_over_itself_is_at_its_height(height, s):
    graph = ramp()
    queries = RoadQueries([graph])
    place = np.array([[60.0, 0.0]])
    assert queries.locate([0], place, height=[height]).s == pytest.approx([s], abs=0.1)
    found, _ = bind(place_on_lane, queries.roads)(0, 60.0, 0.0, height)
    assert found == pytest.approx(s, abs=0.1)
