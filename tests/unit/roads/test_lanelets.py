"""Maps of lanelets as lane graphs, by hand."""

import numpy as np
import pytest
import shapely

from smarts.errors import MapError
from smarts.roads.compile import compile_map
from smarts.roads.lane_graph import ConflictKind, LaneKind
from smarts.roads.lanelet_readers.commonroad import read
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
    assert roads.kind[at["road-3-4_1"]] == LaneKind.BUS
    whole = np.concatenate([line(roads, "road-1-2_1"), line(roads, "road-3-4_1")])
    assert whole[:, 1] == pytest.approx(3.5, abs=0.01)
    assert whole[[0, -1], 0] == pytest.approx([0, 100], abs=0.01)


def test_lanelets_that_cross_in_a_junction_conflict(tmp_path):
    """Two one-way streets cross at the origin; a lanelet inside a junction without crossing stays a road."""
    ns = [[(0.0, -60.0 + 50 * k), (0.0, -10.0 + 50 * k)] for k in (0, 2)]
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
    assert len(ns) == 2
    east = [
        lanelet("e1", [(-60, 0), (-10, 0)], successors=["e2"]),
        lanelet("e2", [(-10, 0), (10, 0)], successors=["e3"]),
        lanelet("e3", [(10, 0), (60, 0)], successors=["e4"]),
        lanelet("e4", [(60, 0), (80, 0)], successors=["e5"]),
        lanelet("e5", [(80, 0), (100, 0)]),
    ]
    marks = "".join(f'<successorsStraight ref="{name}"/>' for name in ("n2", "e2", "e4"))
    junction = f'<intersection id="8"><incoming id="9">{marks}</incoming></intersection>'
    roads = roads_of(commonroad(tmp_path / "x.xml", *turned, *east, junction), tmp_path)
    names = [name for name in roads.edge_ids if not name.startswith(":")]
    assert sorted(names) == ["road-e1", "road-e3", "road-e4", "road-e5", "road-n1", "road-n3"]
    crossing = np.flatnonzero(roads.conflict_kind == ConflictKind.CROSS)
    lanes = [roads.conflict_lane[each] for each in crossing]
    assert len(lanes) == 2
    inside = line(roads, roads.lane_ids[lanes[0]])
    assert np.abs(inside).min() < 0.5
    assert np.ptp(inside, axis=0).max() > 18


@pytest.mark.parametrize(
    ("parts", "problem"),
    [
        ([], "the file has no lanelets"),
        ([lanelet("7", [(0, 0)])], "leftBound of the lanelet '7' has no two points"),
    ],
)
def test_broken_maps_are_refused(tmp_path, parts, problem):
    with pytest.raises(MapError, match=problem):
        read(commonroad(tmp_path / "x.xml", *parts))


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
