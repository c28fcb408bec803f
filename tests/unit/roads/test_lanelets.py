"""Maps of lanelets as lane graphs, by hand."""

import json

import numpy as np
import pytest
import shapely

from smarts.errors import MapError
from smarts.roads.compile import compile_map
from smarts.roads.lane_graph import ConflictKind, LaneKind
from smarts.roads.lanelet_readers import lanelet2
from smarts.roads.lanelet_readers.commonroad import read
from smarts.roads.lanelets import Lanelet, read_lanelets
from smarts.roads.sources import MapSource, find_map_source
from smarts.roads.sumo_net import read_net
from tests.recording_files import DATA, commonroad, lanelet, needs_data, tags

LIMIT = '<trafficSign id="9">' + tags(trafficSignElement=tags(trafficSignID="274", additionalValue=16.5))
SPLIT = [
    lanelet("1", [(0, 0), (50, 0)], successors=("3", "5"), left="2"),
    lanelet("2", [(0, 3.5), (50, 3.5)], successors="4", right="1"),
    lanelet("3", [(50, 0), (100, 0)], left="4", kind="highway"),
    lanelet("4", [(50, 3.5), (100, 3.5)], right="3", kind="busLane"),
    lanelet("5", [(50, 0), (80, -3), (110, -12)], width=3.0).replace(
        "<laneletType>", '<trafficSignRef ref="9"/><laneletType>'
    ),
    LIMIT + "</trafficSign>",
]


def roads_of(path, tmp_path):
    compile_map(MapSource("commonroad", (path,)), tmp_path / "out.net.xml")
    return read_net(tmp_path / "out.net.xml")


def line(roads, name):
    lane = roads.lane_ids.index(name)
    return roads.point_xy[roads.point_start[lane] : roads.point_start[lane + 1]]


def test_a_road_that_splits(tmp_path):
    commonroad(tmp_path / "map.cr.xml", *SPLIT)
    source = find_map_source(tmp_path)
    assert source.kind == "commonroad"
    roads = roads_of(source.files[0], tmp_path)
    at = {name: roads.lane_ids.index(name) for name in roads.lane_ids}
    assert {name for name in at if not name.startswith(":")} == {
        *("road-1-2_0", "road-1-2_1", "road-3-4_0", "road-3-4_1", "road-5_0"),
    }
    assert roads.left[at["road-1-2_0"]] == at["road-1-2_1"]
    beyond = {
        roads.lane_ids[after]
        for inside in roads.successor[slice(*roads.successor_start[at["road-1-2_0"] :][:2])]
        for after in roads.successor[slice(*roads.successor_start[inside:][:2])]
    }
    assert beyond == {"road-3-4_0", "road-5_0"}
    assert roads.width[at["road-5_0"]] == pytest.approx(3.0, abs=0.2)
    assert roads.width[at["road-1-2_1"]] == pytest.approx(3.5)
    limits = {"road-1-2_0": 50 / 3.6, "road-3-4_0": 130 / 3.6, "road-5_0": 16.5}
    assert {name: roads.speed_limit[at[name]] for name in limits} == pytest.approx(limits, abs=0.01)
    assert [each.assumes_limit for each in read(source.files[0])] == [True] * 4 + [False]
    assert roads.kind[at["road-3-4_1"]] == LaneKind.BUS
    whole = np.concatenate([line(roads, "road-1-2_1"), line(roads, "road-3-4_1")])
    assert whole[:, 1] == pytest.approx(3.5, abs=0.01)
    assert whole[[0, -1], 0] == pytest.approx([0, 100], abs=0.01)


@pytest.mark.parametrize("is_marked", [True, False])
def test_lanelets_that_cross_in_a_junction_conflict(tmp_path, is_marked):
    """Two one-way streets cross at the origin; a lanelet inside a junction without crossing stays a road."""
    turned = [  # bounds of `lanelet` are beside it along y, so streets along y are drawn by hand
        f'<lanelet id="{name}">'
        + "".join(
            tags(**{side: "".join(tags(point=tags(x=x, y=y)) for y in ends)})
            for side, x in (("leftBound", -1.75), ("rightBound", 1.75))
        )
        + f"{link}</lanelet>"
        for name, ends, link in (
            ("n1", (-60, -10), '<successor ref="n2"/>'),
            ("n2", (-10, 10), '<successor ref="n3"/>'),
            ("n3", (10, 60), ""),
        )
    ]
    east = [
        lanelet("e1", [(-60, 0), (-10, 0)], successors=["e2"]),
        lanelet("e2", [(-10, 0), (10, 0)], successors=["e3"]),
        lanelet("e3", [(10, 0), (60, 0)], successors=["e4"]),
        lanelet("e4", [(60, 0), (80, 0)], successors=["e5"]),
        lanelet("e5", [(80, 0), (100, 0)]),
    ]
    marks = "".join(f'<successorsStraight ref="{name}"/>' for name in ("n2", "e2", "e4"))
    junction = f'<intersection id="8"><incoming id="9">{marks}</incoming></intersection>'
    marked = (junction,) if is_marked else ()
    roads = roads_of(commonroad(tmp_path / "x.xml", *turned, *east, *marked), tmp_path)
    names = [name for name in roads.edge_ids if not name.startswith(":")]
    assert sorted(names) == ["road-e1", "road-e3", "road-e4", "road-e5", "road-n1", "road-n3"]
    crossing = np.flatnonzero(roads.conflict_kind == ConflictKind.CROSS)
    lanes = [roads.conflict_lane[each] for each in crossing]
    assert len(lanes) == 2
    inside = line(roads, roads.lane_ids[lanes[0]])
    assert np.abs(inside).min() < 0.5
    assert np.ptp(inside, axis=0).max() > 18


def write_lanelet2(path, lanelets, place):
    """Write lanelets as Lanelet2's relations; neighbours share ways, of which each second leads backward.

    Args:
        place: Returns a node's attributes and tags at a position.
    """
    nodes, ways, relations = {}, {}, []
    for each in lanelets:
        members = ""
        for role, bound in (("left", each.left), ("right", each.right)):
            way = tuple(nodes.setdefault(tuple(point), f"{len(nodes) + 1}") for point in bound.tolist())
            members += f'<member type="way" role="{role}" ref="{ways.setdefault(way, f"w{len(ways)}")}"/>'
        kind = "bus_lane" if each.kind == LaneKind.BUS else "road"
        marks = {"type": "lanelet", "subtype": kind, "speed_limit": f"{each.speed * 3.6} km/h"}
        marks |= {"turn_direction": "left"} if each.inside else {}
        texts = "".join(f'<tag k="{k}" v="{v}"/>' for k, v in marks.items())
        relations.append(f'<relation id="{each.id}">{members}{texts}</relation>')
    points = "".join(f'<node id="{name}" {place(*point)}</node>' for point, name in nodes.items())
    lines = "".join(
        f'<way id="{name}">'
        + "".join(f'<nd ref="{node}"/>' for node in (way if int(name[1:]) % 2 else way[::-1]))
        + "</way>"
        for way, name in ways.items()
    )
    path.write_text(f"<osm>{points}{lines}{''.join(relations)}</osm>")
    return path


def test_lanelet2_gives_the_same_lanelets(tmp_path):
    ramp = lanelet("5", [(50, 0), (80, -3), (110, -12)])
    drawn = read(commonroad(tmp_path / "x.xml", *(part for part in SPLIT if 'id="5"' not in part), ramp))

    def place(x, y):
        return f'lat="0" lon="0"><tag k="local_x" v="{x}"/><tag k="local_y" v="{y}"/>'

    file = write_lanelet2(tmp_path / "map.lanelet2.osm", drawn, place)
    assert find_map_source(tmp_path).kind == "lanelet2"
    for one, other in zip(drawn, lanelet2.read(file), strict=True):
        assert (one.id, one.left_neighbour, one.kind) == (other.id, other.left_neighbour, other.kind)
        assert set(one.successors) == set(other.successors)
        assert one.speed == pytest.approx(other.speed)
        assert np.array_equal(one.left, other.left)
        assert np.array_equal(one.right, other.right)


def test_speed_limits_of_lanelet2():
    found = [lanelet2._limit({"speed_limit": text}) for text in ("50", "50km/h", "50 km/h", "30 mph", "")]
    assert found == pytest.approx([13.889, 13.889, 13.889, 13.411, 0], abs=1e-3)


def test_lanelet2_by_latitude_and_longitude(tmp_path):
    """At the equator a second of arc is 30.71 m to the north, 30.92 m to the east (WGS84), by UTM's scale."""
    drawn = read(commonroad(tmp_path / "x.xml", lanelet("1", [(0, 0), (1, 0)], width=0.2)))
    file = write_lanelet2(tmp_path / "x.osm", drawn, lambda x, y: f'lat="{y / 3600}" lon="{x / 3600}">')
    (read_back,) = lanelet2.read(file)
    scale = 0.9996 * (1 + np.radians(3) ** 2 / 2)  # three degrees from the central meridian
    assert read_back.left == pytest.approx(np.array([[0, 3.071], [30.92, 3.071]]) * scale, abs=0.02)


def test_utm():
    """The CN Tower is at 43 38 33.24 N, 79 23 13.7 W, which is 17T 630084 4833438 (USGS)."""
    angles = np.array([[43 + 38 / 60 + 33.24 / 3600, -79 - 23 / 60 - 13.7 / 3600]])
    assert lanelet2._utm(angles, np.array([16.0]))[0] == pytest.approx([630084, 4833438], abs=1.0)


def test_argoverse_gives_the_same_lanelets(tmp_path):
    """And of two lanes in opposite directions, each of which is left of the other, neither is a neighbour."""
    drawn = read(commonroad(tmp_path / "x.xml", *(part.replace("highway", "urban") for part in SPLIT[:4])))
    left = drawn[1].left[::-1]
    drawn.append(Lanelet("7", left, left + np.array([0, 3.5])))
    opposite = {"2": 7, "7": 2}
    segments = {
        each.id: {
            "id": int(each.id),
            "lane_type": "BUS" if each.kind == LaneKind.BUS else "VEHICLE",
            "is_intersection": each.inside,
            "left_lane_boundary": [{"x": x, "y": y, "z": 1.0} for x, y in each.left.tolist()],
            "right_lane_boundary": [{"x": x, "y": y, "z": 1.0} for x, y in each.right.tolist()],
            "left_neighbor_id": opposite.get(each.id) or (int(each.left_neighbour or 0) or None),
            "right_neighbor_id": next((int(x.id) for x in drawn if x.left_neighbour == each.id), None),
            "successors": [int(other) for other in (*each.successors, "99") if other != "5"],
        }
        for each in drawn
    }
    (tmp_path / "map.argoverse.json").write_text(json.dumps({"lane_segments": segments}))
    found = find_map_source(tmp_path)
    assert found.kind == "argoverse"
    for one, other in zip(drawn, read_lanelets(found.kind, found.files[0]), strict=True):
        assert (one.id, one.left_neighbour, one.kind) == (other.id, other.left_neighbour, other.kind)
        assert {*one.successors} - {"5"} == {*other.successors}
        assert np.array_equal(one.left, other.left)
        assert np.array_equal(one.right, other.right)


@pytest.mark.parametrize(
    ("parts", "problem"),
    [
        ([], "it has no lanelets"),
        ([lanelet("7", [(0, 0)])], "leftBound of the lanelet '7' has no two points"),
    ],
)
def test_broken_maps_are_refused(tmp_path, parts, problem):
    with pytest.raises(MapError, match=problem):
        read_lanelets("commonroad", commonroad(tmp_path / "x.xml", *parts))


@pytest.mark.parametrize("kind", ["commonroad", "lanelet2"])
def test_files_that_are_cut_off_are_refused(tmp_path, kind):
    (tmp_path / "x.xml").write_text("<osm><relation>")
    with pytest.raises(MapError, match=f"not a map of kind {kind}: (no element found|Expecting value)"):
        read_lanelets(kind, tmp_path / "x.xml")


def test_a_lanelet_without_its_way_is_refused(tmp_path):
    marks = '<tag k="type" v="lanelet"/><tag k="subtype" v="road"/><member role="left" ref="w7"/>'
    (tmp_path / "x.osm").write_text(f'<osm><relation id="3">{marks}</relation></osm>')
    with pytest.raises(MapError, match="'w7' is missing"):
        read_lanelets("lanelet2", tmp_path / "x.osm")


@needs_data
@pytest.mark.parametrize("name", ["mona/DEU_MONAWest-2_1_T-300", "ngsim/USA_Lanker-1_3_T-1"])
def test_real_maps_keep_their_centrelines(tmp_path, name):
    path = DATA / f"{name}.xml"
    roads = roads_of(path, tmp_path)
    net = shapely.STRtree([shapely.LineString(line(roads, each)) for each in roads.lane_ids])
    lines = [shapely.LineString((each.left + each.right) / 2) for each in read(path)]
    points = [shapely.line_interpolate_point(each, np.arange(2, each.length - 1)) for each in lines]
    _, apart = net.query_nearest(np.concatenate(points), return_distance=True, all_matches=False)
    assert len(lines) > 30
    assert np.percentile(apart, 95) < 0.05
