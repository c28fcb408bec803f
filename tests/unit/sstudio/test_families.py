"""Families of maps: drawn by name, always the same, never two equal, and built as any other scenario."""

import runpy
from collections import Counter

import numpy as np
import pytest

from smarts.errors import MapError, ScenarioError
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described, build_scenario, build_scenarios, matching, read_scenario
from smarts.sstudio.collecting import collecting
from smarts.sstudio.locating import SUITE
from tests.raising import raises

FAMILIES = ("intersections", "double_merges", "two_ways", "on_ramps")
ROADS = """
from pathlib import Path

from smarts.sstudio import gen_family
from smarts.sstudio import types as t

NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="{}" y="0"/></nodes>'
EDGES = '<edges><edge id="road" from="a" to="b"/></edges>'


def draw(generator):
    length = 100 + int(generator.integers(3))
    return t.Scenario(map_spec=t.MapSpec(plain={"nod": NODES.format(length), "edg": EDGES}))


gen_family(draw, Path(__file__).parent, {"train": 1, "test": 2})
"""
"""A family of three roads, of which no others could be drawn."""


def described(family: str, name: str | None) -> t.Scenario:
    with collecting(name) as collection:
        runpy.run_path(str(SUITE / family / "scenario.py"))
    assert collection.is_wanted == (name is not None)
    return collection.scenario


def geometry(roads: LaneGraph) -> bytes:
    return np.round(roads.point_xy, 1).tobytes()


def test_maps_of_a_family_are_variations_that_differ(tmp_path):
    (tmp_path / "roads").mkdir()
    (tmp_path / "roads" / "scenario.py").write_text(ROADS)
    family = str(tmp_path / "roads")
    names = matching(f"{family}@train-*") + matching(f"{family}@test-*")
    assert [name.partition("@")[2] for name in names] == ["train-00", "test-00", "test-01"]
    assert read_scenario(names[1]).map_spec.plain is not None
    assert not (tmp_path / "roads" / "build").exists()
    told = []
    build_scenarios([*names, names[0]], lambda *counts: told.append(counts))
    assert told == [(1, 3), (2, 3), (3, 3)]
    build_scenarios(names, pytest.fail)
    built = [build_scenario(name) for name in names]
    assert {round(each.roads().length.max()) for each in built} == {100, 101, 102}
    assert [each.directory for each in built] == [build_scenario(name).directory for name in names]
    assert geometry(build_scenario(family).roads()) == geometry(built[0].roads())
    with raises(ScenarioError, values=["'test-02'", "'test-01'"]):
        build_scenario(f"{family}@test-02")
    (tmp_path / "roads" / "scenario.py").write_text(ROADS.replace('"test": 2', '"test": 3'))
    with raises(ScenarioError, values=["test-02 equals earlier ones"]):
        build_scenario(f"{family}@test-02")


@pytest.mark.parametrize(
    ("kinds", "kind", "said"),
    [
        ({"nodes": "<nodes/>"}, ScenarioError, "'nod'"),
        ({"nod": "<nodes/>", "edg": '<edges><edge id="road" from="a" to="b"/></edges>'}, MapError, "'a'"),
    ],
)
def test_what_is_wrong_with_the_texts_of_a_map_is_said_of_the_scenario(kinds, kind, said, tmp_path):
    with raises(kind, "map_spec.plain", values=[tmp_path, said]):
        build_described(tmp_path, t.Scenario(map_spec=t.MapSpec(plain=kinds)))


@pytest.mark.parametrize("family", FAMILIES)
def test_a_name_means_one_map(family):
    assert described(family, "train-03") == described(family, "train-03")
    assert described(family, None).map_spec == described(family, "train-00").map_spec
    assert Counter(name.split("-")[0] for name in described(family, None).held_out) == {
        "train": 50,
        "validation": 10,
        "test": 30,
    }


def test_a_crossing_worked_out_by_hand(tmp_path):
    """Four arms of one lane at right angles: netconvert's corners of 4 m end 7.2 m from the centre."""
    crossing = runpy.run_path(str(SUITE / "intersections" / "scenario.py"))
    arms = [crossing["Arm"](f"arm{i}", i * np.pi / 2, 1, i % 2 == 0) for i in range(4)]
    spec = crossing["road_map"](arms, [60.0, 60.0, 70.0, 70.0], 3.2, 10.0, signals=False)
    roads = build_described(tmp_path, t.Scenario(map_spec=spec)).roads()
    lengths = {
        roads.edge_ids[roads.lane_edge[i]]: roads.length[i] for i in np.flatnonzero(~roads.is_internal)
    }
    assert len(lengths) == len(np.flatnonzero(~roads.is_internal)) == 16
    for i, length in enumerate((60.0, 60.0, 70.0, 70.0)):
        assert lengths[f"arm{i}_in"] == pytest.approx(length, abs=0.02)
        assert lengths[f"arm{i}_approach"] == pytest.approx(100.0, abs=0.02)
    inside = [name for name in roads.lane_ids if name.startswith(":center")]
    assert len(inside) == 12, "from each arm to each other one"
    # The road from the east drives on the north side, half a lane from the middle.
    x, y, heading = roads.pose_at(roads.lane_number("arm0_in", 0), 0.0)
    assert (x, y, abs(heading)) == pytest.approx((67.2, 1.6, np.pi), abs=0.02)


@pytest.mark.nightly
@pytest.mark.parametrize("family", FAMILIES)
def test_all_maps_of_a_family_differ_and_have_the_signals_that_they_name(family):
    built = [build_scenario(f"{family}@{name}") for name in build_scenario(family).held_out]
    assert len({geometry(each.roads()) for each in built}) == len(built) == 90
    for each in built:
        signals = "traffic_light" in each.scenario.map_spec.plain["nod"]
        assert len(each.roads().signal_ids) == signals
        assert not each.warnings
